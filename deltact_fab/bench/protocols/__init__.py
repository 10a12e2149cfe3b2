"""Protocols: a declaration expands into steps with stable ids; static checks come before motion."""
