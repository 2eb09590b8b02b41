"""Forces over time and what the claim says of the answer; where the stress is largest.

May import: basics, body, model.
"""
