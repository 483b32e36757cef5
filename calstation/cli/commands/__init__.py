"""The commands: each module is a command or a group of commands of its name, and is imported when it is called.

A module has an `app`, made by `command_group`, whose functions are its commands. The families `command` and `option` of
the catalogue hold their help, and the program lists the modules that are here. More than 15: one a command.
"""
