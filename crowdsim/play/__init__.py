"""Scenarios that a user plays live, and runs that are simulated again to explain their decisions.

A ``Session`` simulates step by step while a user interferes, and saves the scenario that repeats what happened. A
``Repeated`` run answers why an avatar decided as it did. Pages of ``view`` show both.
"""
