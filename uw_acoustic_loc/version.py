"""The package's version; setup.py and package.xml have the same."""

__version__ = "0.1.0"
