/* Where planning and sampling a PPO spend their time: the kernel alone, no Python. Times of the paper's case (or of another law: argument 2),
 * medians of interleaved rounds [us].
 *
 *     planning ROUNDS [LAW [WHAT]]
 *
 * With WHAT (plan, sample, corner, joints) only that is repeated, ROUNDS times, for a profiler. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "delta_arms.h"
#include "kernel.h"

enum { PARTS = 4, MOST = 100000 };

static const dph_robot robot = {0.2, 0.045, 0.35, 0.8, 1.397, 0.1443, 0.0506, 0.273, 0.016746, 0.5, 0.0724, -0.75, 1.75};
static dph_task task = {.pick = {-0.1525, 0.0, -0.8},
                        .place = {0.1525, 0.0, -0.8},
                        .lift = {0.05, 0.05},
                        .corner_deviation = {0.006, 0.006},
                        .corner_entry_speed = 1.2,
                        .corner_mid_speed = 0.8,
                        .traverse_speed = 2.4,
                        .overlap = 0.5,
                        .limits = {.joint_velocity = {4.4227, 4.4227, 4.4227},
                                   .joint_acceleration = {241.365, 241.365, 241.365},
                                   .joint_jerk = {29965.0, 29965.0, 29965.0},
                                   .joint_torque = {1e30, 1e30, 1e30},
                                   .tcp_speed = 1e30}};
static const char *const part_name[PARTS] = {"plan", "sample", "corner", "joints"};

static dph_workspace *workspace;
static dph_plan plan;
static dph_setpoint setpoint[1024];
static double moment[1024], in_corner[1024], gamma[1024], sink;
static int moments, in_corners;

static void run(int part)
{
    switch (part) {
    case 0:
        if (dph_plan_make(&robot, &task, workspace, &plan).status != DPH_STATUS_OK)
            exit(1);
        break;
    case 1:
        dph_plan_sample_array(&plan, moments, moment, setpoint);
        break;
    case 2:
        dph_corner_law_gamma(&plan.side[0].corner, in_corners, in_corner, gamma, NULL);
        sink += gamma[0];
        break;
    default:
        for (int i = 0; i < moments; ++i) {
            double theta[3];
            (void)dph_inverse_kinematics(&robot, setpoint[i].tcp_position, theta);
            sink += theta[0];
        }
    }
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv)
{
    static double spent[PARTS][MOST];
    int rounds = argc > 1 ? atoi(argv[1]) : 1000;
    task.law = argc > 2 ? (dph_law)atoi(argv[2]) : DPH_LAW_PAPER;
    workspace = malloc((size_t)dph_workspace_size());
    run(0);
    for (moments = 0; moments <= plan.duration_ms; ++moments)
        moment[moments] = moments / 1e3;
    double begin = plan.boundary[1], length = plan.boundary[2] - begin;
    for (int i = 0; i < moments; ++i)
        if (moment[i] * plan.speed_factor > begin && moment[i] * plan.speed_factor < begin + length)
            in_corner[in_corners++] = moment[i] * plan.speed_factor - begin;
    run(1);
    if (argc > 3) {
        for (int part = 0; part < PARTS; ++part)
            for (int i = 0; i < rounds && strcmp(argv[3], part_name[part]) == 0; ++i)
                run(part);
        return 0;
    }
    for (int i = 0; i < rounds && i < MOST; ++i)
        for (int part = 0; part < PARTS; ++part) {
            struct timespec before, after;
            clock_gettime(CLOCK_MONOTONIC, &before);
            run(part);
            clock_gettime(CLOCK_MONOTONIC, &after);
            spent[part][i] = 1e6 * (double)(after.tv_sec - before.tv_sec) + 1e-3 * (double)(after.tv_nsec - before.tv_nsec);
        }
    for (int part = 0; part < PARTS; ++part) {
        qsort(spent[part], (size_t)rounds, sizeof(double), by_value);
        printf("%s %.2f\n", part_name[part], spent[part][rounds / 2]);
    }
    free(workspace);
    return sink == 0.0;
}
