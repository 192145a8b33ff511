"""What generated code says about its frames, in every language alike."""

from __future__ import annotations

from kfgen.model.filter import FilterModel

AXES = {"N": "north", "E": "east", "S": "south", "W": "west", "U": "up", "D": "down"}


def frames(model: FilterModel) -> tuple[str, ...]:
    """Navigation axes, body axes, the quaternion and the convention of the error, a sentence each."""
    axes = ", ".join(AXES.get(a, a) for a in model.motion.axes)
    said = [f"Navigation axes: {axes}.", "Body axes: forward, right, down."]
    if model.attitude is not None:
        said += ["Quaternion: body to navigation axes, scalar first.", f"Error: {model.convention.title}."]
    return (*said, "SI units and radians.")
