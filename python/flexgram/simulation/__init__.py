"""Forces over time, what the claim says of the answer, where the stress is largest.

May import: basics, body, model.
"""
