/* Where planning and sampling a PPO spend their time: the kernel alone, no Python. planning.py compiles it and writes case.h, the robot and
 * the task. Medians of interleaved rounds [us].
 *
 *     planning ROUNDS LAW [WHAT]
 *
 * With WHAT (plan, sample, joints, corner, inverse) only that is repeated, ROUNDS times, for a profiler. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "delta_arms.h"
#include "kernel.h"

#include "case.h" /* static const dph_robot robot; static dph_task task */

enum { PARTS = 5, MOST = 100000, SETPOINTS = 4096 };

static const char *const part_name[PARTS] = {"plan", "sample", "joints", "corner", "inverse"};

static dph_workspace *workspace;
static dph_plan plan;
static dph_setpoint setpoint[SETPOINTS];
static double moment[SETPOINTS], in_corner[SETPOINTS], gamma[SETPOINTS], joint[3][3 * SETPOINTS], sink;
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
        dph_plan_sample_joints(&plan, moments, moment, joint[0], joint[1], joint[2]);
        break;
    case 3:
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
    if (argc < 3)
        return 2;
    int rounds = atoi(argv[1]);
    rounds = rounds < 1 ? 1 : rounds > MOST ? MOST : rounds;
    task.law = (dph_law)atoi(argv[2]);
    workspace = malloc((size_t)dph_workspace_size());
    run(0);
    for (moments = 0; moments <= plan.duration_ms && moments < SETPOINTS; ++moments)
        moment[moments] = moments / 1e3;
    for (int i = 0; i < moments; ++i) {
        double nominal = plan.speed_factor * moment[i];
        if (nominal > plan.boundary[1] && nominal < plan.boundary[2])
            in_corner[in_corners++] = nominal - plan.boundary[1];
    }
    run(1);
    if (argc > 3) {
        for (int part = 0; part < PARTS; ++part)
            for (int i = 0; i < rounds && strcmp(argv[3], part_name[part]) == 0; ++i)
                run(part);
        return 0;
    }
    for (int i = 0; i < rounds; ++i)
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
