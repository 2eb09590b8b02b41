"""The reduced body: matrices, file, claim, response, geometry, stress, other forms of it.

May import: basics, body.
"""
