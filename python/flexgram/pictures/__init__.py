"""Figures of a reduced body, pictures of sweeps, the page made of them.

May import: basics, body, model, simulation, measured.
"""
