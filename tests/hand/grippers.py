"""A small hand as a model file, with what a reader can get wrong: offset hinges, two of one body, a mesh."""

TWO_FINGERS = """
<mujoco>
  <compiler angle="{angle}" autolimits="true"/>
  <asset>
    <mesh name="wedge" vertex="0 -.012 0  0 .012 0  .012 -.012 0  .012 .012 0  0 -.012 .03  0 .012 .03"/>
    <material name="steel" rgba=".6 .6 .7 1"/>
  </asset>
  <worldbody>
    <body name="palm" pos=".3 0 .1" euler="0 0 {turn}">
      <freejoint/>
      <geom name="palm" type="box" size=".015 .05 .03" material="steel"/>
      <geom name="drawn" type="sphere" size=".2" contype="0" conaffinity="0"/>
      <site name="face" pos=".015 0 .01"/>
      <body name="left" pos="0 .04 .035">
        <joint name="left_turn" axis="0 0 1" range="{turns}"/>
        <joint name="left_bend" axis="0 1 0" pos="0 0 .004" range="{bends}"/>
        <geom type="capsule" fromto="0 0 .01 0 0 .07" size=".008"/>
        <body name="left_end" pos="0 0 .075" euler="0 {tilt} 0">
          <joint name="left_curl" axis="0 1 0" pos="0 0 .002" range="{bends}" ref="{tilt}"/>
          <geom type="mesh" mesh="wedge" pos="0 0 .006"/>
          <geom type="cylinder" size=".006 .008" pos="0 0 .012"/>
          <site name="left_low" pos=".008 0 .015"/>
          <body name="left_cap" pos="0 0 .04">
            <geom type="ellipsoid" size=".012 .012 .008"/>
            <site name="left_high" pos=".012 0 0"/>
          </body>
        </body>
      </body>
      <body name="right" pos="0 -.04 .035">
        <joint name="right_bend" axis="0 1 0" range="{bends}"/>
        <geom type="capsule" fromto="0 0 .01 0 0 .07" size=".008"/>
        <body name="right_end" pos="0 0 .085">
          <joint name="right_curl" axis="0 1 0" range="{bends}"/>
          <geom type="box" size=".01 .012 .02" pos="0 0 .02"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

SENSORS = {
    "anchor": "face",
    "sensors": [
        {"site": "left_low"},
        {"site": "left_high"},
        {"body": "right_end", "position": [0.01, 0, 0.01]},
        {"body": "right_end", "position": [0.01, 0, 0.03], "rotation": [0.1, 0, 0]},
    ],
}


def two_fingers(angle: str) -> str:
    """The model with its angles in "degree" or "radian"."""
    one = 1.0 if angle == "degree" else 0.017453292519943295

    def in_unit(*degrees):
        return " ".join(f"{value * one:.12g}" for value in degrees)

    return TWO_FINGERS.format(
        angle=angle, turn=in_unit(30), turns=in_unit(-20, 20), bends=in_unit(-15, 90), tilt=in_unit(10)
    )
