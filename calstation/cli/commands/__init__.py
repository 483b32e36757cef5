"""The commands, one module for each command or group of commands, which is imported when it is called.

A module has an `app`, made by `command_group`, whose functions are its commands. The program lists these modules, and
the families `command` and `option` of the catalogue contain their help. There are more than 15 modules, because each
command has its own.
"""
