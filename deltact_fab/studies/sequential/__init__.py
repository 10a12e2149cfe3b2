"""Runs that end when their presses to validate show a goal."""
