"""The version of the package, which files and results carry."""

VERSION = "0.3.0"
