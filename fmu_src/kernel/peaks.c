/* Peaks of a plan over continuous time. */
#include <math.h>

#include "laws.h"

/* Channels: four of three joints each, then tcp speed and acceleration. */
enum { CHANNELS = 14, SCAN = 128 };

static double norm(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void channels_at(const dph_plan *plan, int piece, double time, double value[CHANNELS])
{
    dph_setpoint s;
    dph_plan_sample_piece(plan, piece, time, &s);
    for (int i = 0; i < 3; ++i) {
        value[i] = fabs(s.joint_velocity[i]);
        value[3 + i] = fabs(s.joint_acceleration[i]);
        value[6 + i] = fabs(s.joint_jerk[i]);
        value[9 + i] = fabs(s.joint_torque[i]);
    }
    value[12] = norm(s.tcp_velocity);
    value[13] = norm(s.tcp_acceleration);
}

/* Golden-section search for the maximum of one channel in [low, high]. A maximum is flat: 40 steps leave 4e-9 of the interval, and so an
 * error of the value far below its rounding. */
static double refine(const dph_plan *plan, int piece, int channel, double low, double high)
{
    static const double golden = 0.61803398874989484820;
    double value[CHANNELS], best = 0.0;
    double left = high - golden * (high - low), right = low + golden * (high - low);
    channels_at(plan, piece, left, value);
    double at_left = value[channel];
    channels_at(plan, piece, right, value);
    double at_right = value[channel];
    for (int i = 0; i < 40; ++i) {
        best = fmax(best, fmax(at_left, at_right));
        if (at_left > at_right) {
            high = right;
            right = left;
            at_right = at_left;
            left = high - golden * (high - low);
            channels_at(plan, piece, left, value);
            at_left = value[channel];
        } else {
            low = left;
            left = right;
            at_left = at_right;
            right = low + golden * (high - low);
            channels_at(plan, piece, right, value);
            at_right = value[channel];
        }
    }
    return fmax(best, fmax(at_left, at_right));
}

/* Peaks within one piece, its ends included: the greatest of a scan, and the maxima that may hide around it. A maximum worth refining
 * lies beside a scanned value that is not below its neighbours and within a tenth of the greatest. */
static void piece_peaks(const dph_plan *plan, int piece, double peak[CHANNELS])
{
    double begin = plan->boundary[piece] / plan->speed_factor, step = (plan->boundary[piece + 1] / plan->speed_factor - begin) / SCAN;
    double scan[SCAN + 1][CHANNELS], greatest[CHANNELS];
    if (!(step > 0.0))
        return;
    for (int c = 0; c < CHANNELS; ++c)
        greatest[c] = peak[c];
    for (int i = 0; i <= SCAN; ++i) {
        channels_at(plan, piece, begin + step * i, scan[i]);
        for (int c = 0; c < CHANNELS; ++c)
            greatest[c] = fmax(greatest[c], scan[i][c]);
    }
    for (int c = 0; c < CHANNELS; ++c) {
        peak[c] = greatest[c];
        for (int i = 0; i <= SCAN; ++i) {
            int before = i > 0 ? i - 1 : 0, after = i < SCAN ? i + 1 : SCAN;
            if (scan[i][c] >= scan[before][c] && scan[i][c] >= scan[after][c] && scan[i][c] > 0.9 * greatest[c])
                peak[c] = fmax(peak[c], refine(plan, piece, c, begin + step * before, begin + step * after));
        }
    }
}

void dph_plan_peaks(const dph_plan *plan, dph_peaks *peaks)
{
    double peak[CHANNELS] = {0.0};
    for (int piece = 0; piece < plan->pieces; ++piece)
        piece_peaks(plan, piece, peak);
    for (int i = 0; i < 3; ++i) {
        peaks->joint_velocity[i] = peak[i];
        peaks->joint_acceleration[i] = peak[3 + i];
        peaks->joint_jerk[i] = peak[6 + i];
        peaks->joint_torque[i] = peak[9 + i];
    }
    peaks->tcp_speed = peak[12];
    peaks->tcp_acceleration = peak[13];
}
