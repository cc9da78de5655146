"""The node in a container of components, in the namespace of an arm: tissue_force.launch.py model:=model.json arm:=PSM1"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "model": ("", "model.json of the identified trocar"),
    "arm": ("PSM1", "namespace of the arm"),
    "joint_state": ("measured_js", "topic of the joint state"),
    "wrench": ("measured_cf", "topic of the wrench"),
}


def generate_launch_description():
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    defaults = PathJoinSubstitution([FindPackageShare("trocar_ros"), "config", "tissue_force.yaml"])
    node = ComposableNode(
        package="trocar_ros",
        plugin="trocar_ros::TissueForceNode",
        name="tissue_force",
        namespace=given["arm"],
        parameters=[defaults, {"model_path": given["model"]}],
        remappings=[("measured_js", given["joint_state"]), ("measured_cf", given["wrench"])],
        extra_arguments=[{"use_intra_process_comms": True}],
    )
    container = ComposableNodeContainer(
        package="rclcpp_components",
        executable="component_container",
        name="trocar_container",
        namespace=given["arm"],
        composable_node_descriptions=[node],
        output="screen",
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, container])
