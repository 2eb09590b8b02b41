"""The command line: one module for a group of verbs.

May import: everything.
"""
