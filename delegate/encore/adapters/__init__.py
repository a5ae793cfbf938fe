"""Adapters: one module per family of USD prims, which reads a prim at a time into arrays and numbers.

They know USD and not the scene under construction (encore.scene_builder) nor what is where
(encore.render_index). What they cannot translate they report.
"""
