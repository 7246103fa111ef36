"""Undo and redo of fields: what stood for a while comes back, and a movement of a hand is one change."""

from robustid.app.explore.history import History


def test_other_fields_are_another_change_also_at_once():
    history = History([1.0, ""], clock=lambda: 0.0)
    history.note([2.0, ""])
    history.note([3.0, ""])
    history.note([3.0, "17.4"])
    assert history.undo() == (3.0, "")
    assert history.undo() == (1.0, "")


def test_changes_without_a_pause_are_taken_back_together_and_come_again():
    now = [0.0]
    history = History([1.0, ""], clock=lambda: now[0])
    history.note([1.0, ""])  # what the page begins with is no change
    assert history.undo() == history.redo() == (1.0, "")
    for seconds, fields in ((0.0, (2.0, "")), (0.5, (3.0, "")), (1.2, (4.0, "")), (9.0, (4.0, "17.4"))):
        now[0] = seconds
        history.note(fields)
    assert history.undo() == (4.0, "")
    history.note((4.0, ""))  # the page says what it was given
    assert history.undo() == (1.0, "")
    assert history.undo() == (1.0, "")  # there is no more
    assert history.redo() == (4.0, "")
    assert history.redo() == (4.0, "17.4")
    assert history.redo() == (4.0, "17.4")
    history.undo()
    history.note((5.0, ""))  # at once, and yet another change than the one that was taken back
    assert history.redo() == (5.0, "")
    assert history.undo() == (4.0, "")
