/* The one sentence for each verdict, composed here once for logs, exceptions and screens alike. */
#include <math.h>
#include <stdio.h>

#include "corner_law.h"
#include "laws.h"

dph_verdict dph_refuse(dph_status status, dph_phase phase, int joint, double required, double available)
{
    dph_verdict verdict = {status, phase, joint, required, available};
    return verdict;
}

dph_verdict dph_accept(void)
{
    return dph_refuse(DPH_STATUS_OK, DPH_PHASE_IDLE, 0, 0.0, 0.0);
}

dph_verdict dph_unfinished(void)
{
    return dph_refuse(DPH_STATUS_PLANNING, DPH_PHASE_IDLE, 0, 0.0, 0.0);
}

static double mm(double m)
{
    return 1e3 * m;
}

/* An upper bound a reader may type in: rounded down. */
static double mm_at_most(double m)
{
    return floor(1e5 * m) / 100.0;
}

static double degrees(double radians)
{
    return radians * (180.0 / 3.14159265358979323846);
}

void dph_verdict_text(const dph_verdict *verdict, char *text, int size)
{
    static const char *const where[] = {"",
                                        " while lifting",
                                        " in the corner above the pick point",
                                        " in the first half of the traverse",
                                        " in the second half of the traverse",
                                        " in the corner above the place point",
                                        " while lowering",
                                        " in the traverse",
                                        " before the motion"};
    const char *phase = where[verdict->phase];
    double required = verdict->required, available = verdict->available;
    size_t n = (size_t)size;

    switch (verdict->status) {
    case DPH_STATUS_NONE:
        snprintf(text, n, "no request yet");
        return;
    case DPH_STATUS_OK:
        snprintf(text, n, "accepted");
        return;
    case DPH_STATUS_INVALID_ROBOT:
        snprintf(text, n, "the robot is not valid: a length, mass or angle is %.6g where %.6g is the bound", available, required);
        return;
    case DPH_STATUS_INVALID_VALUE:
        snprintf(text, n, "the task has the value %.6g where one of %s %.6g is needed", available,
                 available > required ? "at most" : "at least", required);
        return;
    case DPH_STATUS_NOT_LEVEL:
        snprintf(text, n, "the traverse would not be level: it begins at z = %.6g mm and ends at z = %.6g mm; change a lift height by %.6g mm",
                 mm(required), mm(available), mm(fabs(required - available)));
        return;
    case DPH_STATUS_LIFT_TOO_LOW:
        snprintf(text, n, "corner deviation %.6g mm does not fit lift height %.6g mm: at most %.6g mm (%s side)", mm(required),
                 mm(dph_corner_leg(available)), mm_at_most(available), verdict->phase == DPH_PHASE_PICK_CORNER ? "pick" : "place");
        return;
    case DPH_STATUS_TRAVERSE_TOO_SHORT:
        snprintf(text, n, "the corners take %.6g mm of the traverse, but pick and place are only %.6g mm apart: a smaller corner deviation or a longer traverse is needed",
                 mm(required), mm(available));
        return;
    case DPH_STATUS_TOO_SLOW:
        snprintf(text, n, "the motion would take %.6g s: at most %.6g s, raise the speeds", required, available);
        return;
    case DPH_STATUS_UNREACHABLE:
        snprintf(text, n, "out of reach of arm %d%s: shoulder and platform joint would be %.6g mm apart, the arm allows %.6g mm",
                 verdict->joint, phase, mm(required), mm(available));
        return;
    case DPH_STATUS_JOINT_RANGE:
        snprintf(text, n, "joint %d would have to turn to %.6g deg%s: its range ends at %.6g deg", verdict->joint, degrees(required),
                 phase, degrees(available));
        return;
    case DPH_STATUS_SINGULAR:
        snprintf(text, n, "too close to a singularity%s: dexterity %.3g, at least %.3g is needed", phase, available, required);
        return;
    case DPH_STATUS_BUSY:
        snprintf(text, n, "busy: another request is being planned or waiting already");
        return;
    case DPH_STATUS_NOT_AT_PICK:
        snprintf(text, n, "the robot rests %.6g mm away from the pick point: at most %.6g mm", mm(required), mm(available));
        return;
    case DPH_STATUS_LIMIT_EXCEEDED:
        snprintf(text, n, "joint %d needs %.5g N m to hold still%s: the torque limit of %.5g N m leaves nothing to move with",
                 verdict->joint, required, phase, available);
        return;
    case DPH_STATUS_NO_LIMIT:
        snprintf(text, n, "the law needs a limit: give at least one of joint velocity, acceleration, jerk, torque, or tcp speed");
        return;
    case DPH_STATUS_PLANNING:
        snprintf(text, n, "being planned");
        return;
    case DPH_STATUS_CANCELLED:
        snprintf(text, n, "cancelled before it began");
        return;
    }
    snprintf(text, n, "unknown verdict %d", (int)verdict->status);
}
