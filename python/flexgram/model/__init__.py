"""The reduced body: its matrices, file, claim in words, responses, geometry, other forms.

May import: basics, body.
"""
