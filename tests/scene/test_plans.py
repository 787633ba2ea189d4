"""Plans as data: parts, reasons, putting back."""

import pytest

from palpate.scene import plans
from palpate.scene.part import Part, stays, unmodelled
from palpate.scene.plans import plan


@pytest.fixture(autouse=True)
def scenes(monkeypatch):
    parts = {
        "hand": Part("no grasp", lambda facts: "a grasp" if facts.get("grasps") else None),
        "gravity": Part("the object can't move"),
        "self-collision": stays("fingers meet"),
        "friction": unmodelled("fingers slide"),
    }
    monkeypatch.setattr(plans, "SCENES", {"image": parts})


def test_what_is_left_out_depends_on_the_facts():
    alone, held = plan("image"), plan("image", grasps=5)
    assert alone.left_out == {"hand": "no grasp", "gravity": "the object can't move"}
    assert alone.kept == {"self-collision": "fingers meet"}
    assert held.kept == {"hand": "a grasp", "self-collision": "fingers meet"}
    assert held.needs("hand") and not alone.needs("hand") and not held.needs("gravity")


def test_putting_back_and_leaving_out_more():
    alone = plan("image")
    assert alone.including("gravity").needs("gravity") and not alone.including("gravity").needs("hand")
    everything = alone.including()
    assert not everything.left_out and everything.needs("hand") and everything.needs("gravity")
    assert not alone.without("self-collision").needs("self-collision")
    assert not alone.needs("hand"), "a plan itself does not change"
    assert alone.including("self-collision") == alone


def test_unknown_scenes_and_parts_are_errors():
    with pytest.raises(KeyError, match="one of image"):
        plan("imagg")
    with pytest.raises(KeyError, match="it has hand, gravity"):
        plan("image").needs("gravty")
    with pytest.raises(KeyError, match="it has hand, gravity"):
        plan("image").including("gravty")


def test_the_text_names_every_part_with_its_reason():
    text = str(plan("image", grasps=5))
    assert "left out: gravity (the object can't move)" in text and "kept: hand (a grasp)" in text
    assert "not modelled: friction (fingers slide)" in text


def test_what_is_not_modelled_is_no_saving_and_comes_in_by_name_only():
    alone = plan("image")
    assert alone.unmodelled == {"friction": "fingers slide"}
    assert not alone.needs("friction") and "friction" not in alone.left_out
    assert not alone.including().needs("friction")
    asked = alone.including("friction")
    assert asked.needs("friction") and not asked.unmodelled and asked.kept["friction"] == "asked for"
    assert asked.left_out == alone.left_out
