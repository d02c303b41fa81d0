"""Simulated rigs for the commands of `calibrate`."""

from pathlib import Path


def rig_toml(folder: Path, side: int, bits: int = 12, **simulation: object) -> Path:
    """Write the configuration of a simulated rig with square frames."""
    lines = "\n".join(f"{key} = {value}" for key, value in simulation.items())
    path = folder / "rig.toml"
    path.write_text(
        f"[lights]\nport = 'simulated'\n[camera]\nbits = {bits}\nwidth_px = {side}\n"
        f"height_px = {side}\n[simulation]\n{lines}\n"
    )
    return path
