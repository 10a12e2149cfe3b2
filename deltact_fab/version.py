"""The version of the package, which files and results carry."""

VERSION = "0.2.0"
