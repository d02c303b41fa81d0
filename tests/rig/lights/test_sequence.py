"""Sequences from the host's side: their report, their errors, the relation of the clocks."""

from collections.abc import Iterator

import pytest

from rig import LightControllerError, Rig, RigConfig, RunningSequence, open_rig
from rig.config.lights import SequencePlan
from rig.lights.driver import Answer
from rig.lights.sequence import ClockRelation


@pytest.fixture(params=["strobe", "trigger"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    camera = {"width_px": 16, "height_px": 16}
    config = RigConfig().with_changes(lights={"synchronisation": request.param}, camera=camera)
    with open_rig(config) as opened:
        yield opened


def plan_of(rig: Rig) -> SequencePlan:
    plan = rig.config.sequence_plan
    assert plan is not None
    return plan


def finish(rig: Rig, sequence: RunningSequence) -> None:
    while sequence.is_running():
        rig.clock.sleep_s(0.01)


def test_the_report_matches_the_board(rig: Rig) -> None:
    plan = plan_of(rig)
    sequence = RunningSequence(rig.lights, plan)
    finish(rig, sequence)
    report = sequence.report()
    assert report.cause is None
    assert tuple(step.light for step in report.steps) == plan.lights
    assert report.clock.uncertainty_s < 0.001
    for step in report.steps:
        # The rig and the simulated board share one clock.
        for at_us in (step.lit_us, step.begun_us, step.ended_us):
            assert at_us is not None
            assert abs(report.clock.on_rig_s(at_us) - at_us / 1e6) <= report.clock.uncertainty_s
        assert (step.triggered_us is not None) == plan.triggers
        assert rig.simulation is not None
        exposed = (step.begun_us / 1e6, step.ended_us / 1e6)
        for led in range(4):
            lit_s = rig.simulation.board.output_integral_s(led, *exposed)
            expected_s = exposed[1] - exposed[0] if led == step.light else 0.0
            assert lit_s == pytest.approx(expected_s, abs=1e-6)


def test_an_aborted_sequence_reports_its_cause(rig: Rig) -> None:
    sequence = RunningSequence(rig.lights, plan_of(rig))
    rig.clock.sleep_s(0.05)
    rig.lights.off()
    assert not sequence.is_running()
    assert sequence.report().cause == "Sequence aborted"


def test_another_sequence_is_not_mistaken_for_this_one(rig: Rig) -> None:
    sequence = RunningSequence(rig.lights, plan_of(rig))
    rig.lights.off()
    finish(rig, RunningSequence(rig.lights, plan_of(rig)))
    with pytest.raises(LightControllerError, match="did it restart"):
        sequence.is_running()


def test_every_exchange_bounds_the_difference_of_the_clocks():
    first = Answer((1_000_000,), sent_s=10.000, received_s=10.004)
    second = Answer((2_000_000,), sent_s=10.999, received_s=11.001)
    relation = ClockRelation.of([(1_000_000, first), (2_000_000, second)])
    assert relation.offset_s == pytest.approx(9.0005)
    assert 0.0005 <= relation.uncertainty_s < 0.001
    restarted = Answer((500,), sent_s=12.0, received_s=12.001)
    with pytest.raises(LightControllerError, match="restart"):
        ClockRelation.of([(1_000_000, first), (500, restarted)])
