/* The robot of a model's variables. Include after the generated model_variables.h: both models have the parameters of robot.toml. */
#ifndef ROBOT_VARIABLES_H
#define ROBOT_VARIABLES_H

#include "kernel/kernel.h"
#include "model_variables.h"

static inline dph_robot robot_from(const Variables *v)
{
    dph_robot robot = {
        .base_radius = v->robot_base_radius,
        .platform_radius = v->robot_platform_radius,
        .upper_arm_length = v->robot_upper_arm_length,
        .forearm_length = v->robot_forearm_length,
        .upper_arm_mass = v->robot_upper_arm_mass,
        .upper_arm_com = v->robot_upper_arm_com,
        .upper_arm_inertia = v->robot_upper_arm_inertia,
        .forearm_mass = v->robot_forearm_mass,
        .forearm_inertia = v->robot_forearm_inertia,
        .platform_mass = v->robot_platform_mass,
        .drive_inertia = v->robot_drive_inertia,
        .joint_position_min = v->robot_joint_position_min,
        .joint_position_max = v->robot_joint_position_max,
    };
    return robot;
}

#endif
