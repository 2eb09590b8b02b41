"""Calls into the compiled module: reduce, certify and Medium.

May import: basics, body, reduced_model.
"""
