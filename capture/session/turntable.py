"""The turntable of a plan, which a command turns."""

import subprocess

from rig import HardwareError

from .plan import SessionPlan


def turn_specimen(plan: SessionPlan, orientation_deg: float) -> None:
    """Let the turntable of a plan, if it has one, turn the specimen."""
    if plan.turntable is None:
        return
    command = plan.turntable_command(orientation_deg)
    try:
        subprocess.run(
            command, check=True, timeout=plan.turntable_timeout_s,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        raise HardwareError(f"turntable {' '.join(command)}: {_cause(error)}") from error


def _cause(error: OSError | subprocess.SubprocessError) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return f"did not end within {error.timeout:g} s"
    if isinstance(error, subprocess.CalledProcessError):
        said = (error.stderr or b"").decode(errors="replace").strip()
        return f"ended with status {error.returncode}" + (f": {said[-200:]}" if said else "")
    return getattr(error, "strerror", None) or str(error)
