"""The commands: each module is a command or a group of commands of its name, and is imported when it is called.

A module has an `app`, made by `command_group`, whose functions are its commands. The program lists these
modules; their help is in the families `command` and `option` of the catalogue. More than 15 modules: one a command.
"""
