"""Calls into the compiled module: `reduce`, `certify` and `Medium`.

May import: basics, body, model, importers, simulation, measured, pictures.
"""
