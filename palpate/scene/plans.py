"""The plan of a scene: which parts its engine is given, which it leaves out, and why.

Engines are built from a plan, so that what the plan says is what happens; `Plan.including` puts a part back
in, by which the report `left_out` and the tests show that the result is the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from palpate.scene import data, models
from palpate.scene.part import Part

# By kind of scene: its parts that an engine can go without.
SCENES: dict[str, dict[str, Part]] = {**data.SCENES, **models.SCENES}


@dataclass(frozen=True)
class Plan:
    """What one scene is made of.

    Attributes:
        scene: its kind, a key of `SCENES`.
        left_out: parts that are left out, and why; kept: parts that could be, and why they are not.
        unmodelled: parts that the model goes without by choice, and why; with them the result is another.
    """

    scene: str
    left_out: Mapping[str, str]
    kept: Mapping[str, str]
    unmodelled: Mapping[str, str] = field(default_factory=dict)

    def needs(self, part: str) -> bool:
        """Whether a part is in. Raises KeyError for a part that scenes of this kind don't have."""
        if part not in SCENES[self.scene]:
            raise KeyError(f"{self.scene} has no part {part!r}: it has {', '.join(SCENES[self.scene])}")
        return part not in self.left_out and part not in self.unmodelled

    def including(self, *parts: str) -> "Plan":
        """The same plan with some parts put back in; with all that are left out if none is named."""
        back = [part for part in parts or self.left_out if not self.needs(part)]
        return replace(
            self,
            left_out={part: why for part, why in self.left_out.items() if part not in back},
            kept={**self.kept, **dict.fromkeys(back, "asked for")},
            unmodelled={part: why for part, why in self.unmodelled.items() if part not in back},
        )

    def without(self, *parts: str) -> "Plan":
        """The same plan with more parts left out, which may change the result."""
        more = {part: "asked to" for part in parts if self.needs(part)}
        return replace(
            self,
            left_out={**self.left_out, **more},
            kept={part: why for part, why in self.kept.items() if part not in more},
        )

    def __str__(self) -> str:
        lines = [f"plan of {self.scene}:"]
        lines += [f"  left out: {part} ({why})" for part, why in self.left_out.items()]
        lines += [f"  kept: {part} ({why})" for part, why in self.kept.items()]
        lines += [f"  not modelled: {part} ({why})" for part, why in self.unmodelled.items()]
        return "\n".join(lines)


def plan(scene: str, **facts: Any) -> Plan:
    """The plan of a scene.

    Args:
        scene: a kind of scene, a key of `SCENES`.
        facts: of this one, where a part depends on them.

    Raises KeyError for an unknown kind.
    """
    if scene not in SCENES:
        raise KeyError(f"no scene {scene!r}: one of {', '.join(SCENES)}")
    left_out, kept, unmodelled = {}, {}, {}
    for name, part in SCENES[scene].items():
        reason = part.keeps(facts)
        if reason is not None:
            kept[name] = reason
        elif part.modelled:
            left_out[name] = part.why
        else:
            unmodelled[name] = part.why
    return Plan(scene, left_out, kept, unmodelled)
