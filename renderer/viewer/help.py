"""The keys, as the window lists them."""

from __future__ import annotations

from fit_material.shaders.tone_mapping import CURVES

KEYS = (
    ("left-drag, wheel, middle-drag", "turn round the model, zoom (as right-drag), shift"),
    ("Tab", "walk: W S A D, Space up, Ctrl down, left-drag looks round; Tab again: turn round the model"),
    ("F", "frame the model"),
    ("F1–F4, Shift+F1–F4", "go to a kept camera, keep this one"),
    ("[ ], Shift+left-drag", "turn the surroundings"),
    ("+ −, 0", "exposure in quarter stops, back to none"),
    ("T", f"tone mapping: {', '.join(CURVES)}"),
    ("B", "background on or off"),
    ("C", "photograph: beside the render, over it (left-drag moves the edge), difference, off"),
    ("N, 1–9", "next photograph, first to ninth"),
    ("P", "picture as PNG and EXR"),
    ("M", "turntable as PNG sequence"),
    ("R", "read the model again, as happens by itself when a file changes"),
    ("H, ?", "these keys"),
    ("Esc", "quit"),
)


def help_text() -> str:
    """The keys, one per line."""
    width = max(len(keys) for keys, _ in KEYS)
    return "\n".join(f"  {keys:{width}}   {what}" for keys, what in KEYS)
