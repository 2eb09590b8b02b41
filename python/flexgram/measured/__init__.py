"""Responses and natural modes as tables and universal files, beside measured ones.

May import: basics, body, model.
"""
