"""Contacts of several engines in one form."""

import numpy as np

from mjbench.simulation.contacts import Contacts

FRAME = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def one(simulation: int, geom: tuple[int, int]) -> Contacts:
    return Contacts.of([simulation], [geom], [-0.01], [[0.0, 0.0, 0.1]], [FRAME])


def test_the_lower_geom_comes_first_with_a_right_handed_frame() -> None:
    contacts = one(0, (3, 1))
    assert contacts.geom.tolist() == [[1, 3]]
    assert contacts.normal.tolist() == [[0.0, 0.0, 1.0]]
    assert np.linalg.det(contacts.frame[0]) == np.linalg.det(FRAME) == 1.0


def test_batches_are_joined_to_one() -> None:
    joined = Contacts.joined([one(1, (0, 1)), one(0, (0, 2))], 4)
    assert joined.simulation.tolist() == [1, 4]
    assert joined.counts(6).tolist() == [0, 1, 0, 0, 1, 0]
    assert joined.first(4).geom.tolist() == [[0, 1]]


def test_a_batch_may_have_no_contacts() -> None:
    assert Contacts.of_c([[], []]).counts(2).tolist() == [0, 0]
