"""Shared options of the command line, and parsing of lines of text."""
