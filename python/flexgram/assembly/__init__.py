"""Reduced bodies with joints and springs between them, and the claim of the whole.

May import: basics, body, model, reduced_model.
"""
