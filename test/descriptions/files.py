"""Descriptions that several tests read, written beside meshes that they name."""

# ruff: noqa: E501

import trimesh

URDF = """
<robot name="arm">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="post">
    <collision><origin xyz="0 0 0.25" rpy="0 0 0"/><geometry><cylinder radius="0.05" length="0.5"/></geometry></collision>
    <collision><origin xyz="0 0 0.6"/><geometry><cone radius="0.1"/></geometry></collision>
  </link>
  <link name="hand">
    <inertial>
      <mass value="2"/><origin xyz="0.1 0 0.02" rpy="0 0 1.5707963267948966"/>
      <inertia ixx="0.001" iyy="0.002" izz="0.0025" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><origin xyz="0.1 0 0"/><geometry>
      <mesh filename="package://arm_meshes/meshes/brick.stl" scale="0.001 0.001 0.001"/></geometry></collision>
    <collision><origin xyz="0.1 0 0.04"/><geometry><box size="0.05 0.05 0.06"/></geometry></collision>
  </link>
  <link name="visual_only"><visual><geometry><sphere radius="0.03"/></geometry></visual></link>
  <link name="frame"/>
  <joint name="stand" type="fixed"><parent link="base"/><child link="post"/>
    <origin xyz="0 0 0.05" rpy="0 0 0"/></joint>
  <joint name="turn" type="revolute"><parent link="post"/><child link="hand"/>
    <origin xyz="0 0 0.5" rpy="0 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="tip" type="prismatic"><parent link="hand"/><child link="visual_only"/>
    <origin xyz="0.2 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="base"/><child link="frame"/></joint>
</robot>
"""

SDF = """<?xml version="1.0"?>
<sdf version="1.9"><world name="kitchen">
  <model name="floor"><static>true</static><link name="link">
    <collision name="c"><geometry><plane><normal>0 0 1</normal><size>9 9</size></plane></geometry>
      <surface><friction><ode><mu>0.7</mu></ode></friction></surface></collision></link></model>
  <model name="table"><static>1</static><pose degrees="true">1 2 0 0 0 90</pose><link name="link">
    <pose>0 0 0.7 0 0 0</pose>
    <collision name="top"><pose>0.1 0 0 0 0 0</pose><geometry><box><size>1 0.5 0.04</size></box></geometry></collision>
    <collision name="leg"><pose>0 0 -0.36 0 0 0</pose>
      <geometry><cylinder><radius>0.03</radius><length>0.68</length></cylinder></geometry></collision>
    <collision name="hill"><geometry><heightmap><uri>a.png</uri></heightmap></geometry></collision></link></model>
  <model name="bar"><static>true</static><pose>3 0 0 0 1.5707963267948966 0</pose><link name="link">
    <collision name="c"><geometry><capsule><radius>0.1</radius><length>0.4</length></capsule></geometry></collision>
  </link></model>
  <model name="lump"><static>true</static><link name="link"><collision name="c"><geometry>
    <mesh><uri>model://arm_meshes/meshes/stone.stl</uri><scale>0.001 0.001 0.001</scale></mesh></geometry></collision>
  </link></model>
  <model name="ball"><pose>1 2 0.8 0 0 0</pose><link name="link"><inertial><mass>0.2</mass></inertial>
    <collision name="c"><geometry><sphere><radius>0.05</radius></sphere></geometry>
      <surface><bounce><restitution_coefficient>0.6</restitution_coefficient></bounce></surface></collision>
  </link></model>
  <model name="door"><link name="leaf"><collision name="c"><geometry><box><size>1 1 1</size></box></geometry>
    </collision></link><joint name="hinge" type="revolute"><parent>world</parent><child>leaf</child></joint></model>
  <model name="odd"><static>true</static><link name="link"><pose relative_to="elsewhere">0 0 0 0 0 0</pose>
    <collision name="c"><geometry><box><size>1 1 1</size></box></geometry></collision></link></model>
  <include><uri>model://post</uri><name>gate</name><pose>0 5 0 0 0 0</pose></include>
  <include><uri>model://nowhere</uri></include>
</world></sdf>
"""

INCLUDED = """
<sdf version="1.9"><model name="post"><static>true</static>
  <frame name="top"><pose>0 0 1 0 0 0</pose></frame>
  <link name="link"><pose relative_to="top">0 0 0.5 0 0 0</pose>
    <collision name="c"><geometry><sphere><radius>0.2</radius></sphere></geometry></collision></link></model></sdf>
"""


def write_descriptions(folder):
    """A robot and a world, in a folder beside that of their meshes."""
    meshes = folder / "arm_meshes" / "meshes"
    meshes.mkdir(parents=True)
    trimesh.creation.box([100.0, 60.0, 40.0]).export(meshes / "brick.stl")
    trimesh.creation.icosphere(subdivisions=1, radius=50.0).export(meshes / "stone.stl")
    (folder / "post").mkdir()
    (folder / "post" / "model.sdf").write_text(INCLUDED)
    (folder / "arm").mkdir()
    (folder / "arm" / "arm.urdf").write_text(URDF)
    (folder / "arm" / "kitchen.sdf").write_text(SDF)
    return folder / "arm"
