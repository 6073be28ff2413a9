"""Viewpoints: trained cameras, virtual views, and the up direction."""
