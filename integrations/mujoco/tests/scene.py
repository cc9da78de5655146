"""The scene of most tests: one body on one joint, one trocar."""


def scene(model, *, mass_kg=0.1, integrator="implicitfast", timestep_s=0.002, joint="insertion", joint_type="slide",
          option="", joint_attributes="", extra="", hinge=None, inertia_kg_m2=1e-5):
    """MJCF with a trocar of the file `model` on a joint, and a sensor of its force; with a `hinge` it turns, too."""
    turns = hinge and f'<config key="hinge" value="{hinge}"/>' or ""
    roll = hinge and '<joint name="roll" type="hinge" axis="0 0 1"/>' or ""
    inertia = f'<inertial pos="0 0 0" mass="{mass_kg}" diaginertia="{inertia_kg_m2} {inertia_kg_m2} {inertia_kg_m2}"/>'
    return f"""
<mujoco>
  <option timestep="{timestep_s}" integrator="{integrator}" gravity="0 0 0">{option}</option>
  <extension>
    <plugin plugin="trocar">
      <instance name="port">
        <config key="model" value="{model}"/>
        <config key="joint" value="{joint}"/>{turns}
      </instance>
    </plugin>
  </extension>
  <worldbody>
    <body>
      <joint name="insertion" type="{joint_type}" axis="0 0 1" {joint_attributes}/>{roll}{hinge and inertia or ""}
      <geom type="capsule" size="0.005 0.1" mass="{mass_kg}"/>
    </body>
  </worldbody>
  <sensor>
    <plugin name="trocar_force" plugin="trocar" instance="port"/>
  </sensor>
  {extra}
</mujoco>
"""
