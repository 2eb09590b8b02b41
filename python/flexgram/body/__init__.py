"""Finite-element bodies: files, meshes, descriptions in YAML, loads, outputs, stresses.

May import: basics.
"""
