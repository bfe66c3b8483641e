"""Numerical stability, stressed: parameter sweeps and random scenes with statuses known beforehand."""
