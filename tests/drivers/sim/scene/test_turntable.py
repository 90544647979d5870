"""The turntable: cameras and room stand still, and the things turn by what is stated and a little more."""

import numpy as np

from drivers.sim.mounting import TURN_SPREAD, table_turn
from drivers.sim.rigs import simulate
from drivers.sim.scene.turntable import turntable_scene


def test_the_things_turn_and_the_room_does_not() -> None:
    rig = simulate("turntable", 3, samples=1, width=80, height=60)
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 80), np.linspace(-0.3, 0.3, 60))
    rays = np.stack([x, y, np.ones_like(x)], -1)
    light, things = [], []
    for frame in (0, 7, 16):
        pose = rig.cam_from_world(0, frame)
        eye, ahead = -pose[:3, :3].T @ pose[:3, 3], rays @ pose[:3, :3]
        whole, alone = rig.scene_at(frame), turntable_scene(room=False)
        light.append(whole.radiance(eye, ahead))
        things.append(alone.depth(eye, ahead) < np.inf)
        # The things have the places of the world at all stops.
        np.testing.assert_array_equal(
            whole.depth(eye, ahead)[things[-1]], alone.depth(eye, ahead)[things[-1]]
        )
    room = ~np.any(things, axis=0)
    assert 0.2 < room.mean() < 0.5
    for one in light[1:]:
        np.testing.assert_allclose(one[room], light[0][room], rtol=2e-3)
        both = things[0] & things[1]
        assert np.median(np.abs(one[both] / light[0][both] - 1)) > 0.1


def test_it_misses_its_stops_by_what_it_states() -> None:
    rig = simulate("turntable", 3)
    stated = rig.turntable
    assert stated is not None
    assert stated.spread == TURN_SPREAD
    missed = [
        table_turn(seed, 24, frame) - stated.degrees[frame] for seed in range(20) for frame in range(1, 24)
    ]
    assert abs(np.std(missed) / TURN_SPREAD - 1) < 0.15
    first, pose = rig.cam_from_world(0, 0), rig.cam_from_world(0, 6)
    turn = first[:3, :3].T @ pose[:3, :3]
    angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))
    assert abs(angle - 90) < 4 * TURN_SPREAD
    assert abs(turn[2, 2] - 1) < 1e-12
