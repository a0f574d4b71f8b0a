"""Colours of a robot's parts in every picture and model."""

COLOURS = {
    "base": "#8a8f98",
    "rail": "#8a8f98",
    "motor": "#30343b",
    "carriage": "#30343b",
    "arm": "#1f5fa8",
    "leg": "#1f5fa8",
    "rod": "#6aa84f",
    "lateral bar": "#e08214",
    "central bar": "#b2182b",
    "passive axis": "#e08214",
    "nacelle": "#b2182b",
    "tool": "#7b3294",
    "sensor": "#00868b",
}
