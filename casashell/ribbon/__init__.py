"""Developable ribbons in ruling-bending coordinates (Pan, Huang and Bao 2016)."""
