"""Finite-element bodies: files, meshes, descriptions in YAML, loads, outputs and stresses.

May import: basics.
"""
