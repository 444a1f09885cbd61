/* DeltaPlanner: takes tasks, plans them with the kernel, plays them on the 1 ms grid, one after the other. */
#include "planner.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmi/model.h"
#include "robot_variables.h"

/* A pick point this near to where the robot rests is taken to be there; setpoints begin where it rests all the same. */
static const double at_pick_tolerance = 1e-6;

/* No task may have more [kg]. */
static const double greatest_payload = 1e6;

static dph_task task_from(const Variables *v)
{
    dph_task task;
    memset(&task, 0, sizeof task); /* padding too: equal states have equal bytes */
    memcpy(task.pick, v->task_pick, sizeof task.pick);
    memcpy(task.place, v->task_place, sizeof task.place);
    task.lift[0] = v->task_lift_pick;
    task.lift[1] = v->task_lift_place;
    task.corner_deviation[0] = v->task_corner_deviation_pick;
    task.corner_deviation[1] = v->task_corner_deviation_place;
    task.dwell = v->task_dwell;
    task.payload = v->payload_mass;
    task.law = (dph_law)v->law;
    task.corner_entry_speed = v->speed_corner_entry;
    task.corner_mid_speed = v->speed_corner_mid;
    task.traverse_speed = v->speed_traverse;
    task.overlap = v->overlap;
    memcpy(task.limits.joint_velocity, v->limit_joint_velocity, sizeof task.limits.joint_velocity);
    memcpy(task.limits.joint_acceleration, v->limit_joint_acceleration, sizeof task.limits.joint_acceleration);
    memcpy(task.limits.joint_jerk, v->limit_joint_jerk, sizeof task.limits.joint_jerk);
    memcpy(task.limits.joint_torque, v->limit_joint_torque, sizeof task.limits.joint_torque);
    task.limits.tcp_speed = v->limit_tcp_speed;
    return task;
}

static double distance(const double a[3], const double b[3])
{
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

/* Let a task begin exactly at a point near its pick point; its traverse stays where it is. */
static void start_at_rest(dph_task *task, const double rest[3])
{
    if (task->lift[0] > 0.0)
        task->lift[0] += task->pick[2] - rest[2];
    memcpy(task->pick, rest, sizeof task->pick);
}

static void report(Model *m, const dph_verdict *verdict, const ModelLog *log)
{
    char sentence[256], text[320];
    dph_verdict_text(verdict, sentence, (int)sizeof sentence);
    if (verdict->status == DPH_STATUS_OK)
        snprintf(text, sizeof text, "plan %d accepted: %.0f ms", (int)m->v.plan_count, 1e3 * m->v.plan_duration);
    else
        snprintf(text, sizeof text, "request refused: %s", sentence);
    log->write(log->context, verdict->status == DPH_STATUS_OK ? MESSAGE_EVENT : MESSAGE_WARNING, text);
}

static void refuse_as_busy(Model *m, const ModelLog *log)
{
    const dph_verdict busy = {DPH_STATUS_BUSY, DPH_PHASE_IDLE, 0, 0.0, 0.0};
    m->v.plan_status = (int32_t)busy.status;
    m->v.plan_required = m->v.plan_available = 0.0;
    m->v.plan_refused += 1;
    report(m, &busy, log);
}

/* Run the waiting plan, which began `ms` ago on its clock: first comes its dwell. */
static void begin_waiting(Model *m, double ms)
{
    m->running = m->waiting;
    m->is_waiting = 0;
    m->has_run = m->is_running = 1;
    m->elapsed_ms = ms - m->running.dwell_ms;
}

/* What became of a request: its plan, in the place of the waiting one, is to run, or it is refused. */
static void conclude(Model *m, dph_verdict verdict, const ModelLog *log)
{
    m->is_planning = 0;
    if (verdict.status == DPH_STATUS_OK && !(m->away <= at_pick_tolerance)) {
        verdict.status = DPH_STATUS_NOT_AT_PICK;
        verdict.required = m->away;
        verdict.available = at_pick_tolerance;
    }
    m->v.plan_status = (int32_t)verdict.status;
    m->v.plan_required = verdict.required;
    m->v.plan_available = verdict.available;
    if (verdict.status == DPH_STATUS_OK) {
        const dph_plan *plan = &m->waiting;
        m->v.plan_count += 1;
        m->v.plan_duration = plan->duration;
        m->v.plan_corner_deviation_pick = plan->corner_deviation[0];
        m->v.plan_corner_deviation_place = plan->corner_deviation[1];
        memcpy(m->rest, plan->task.place, sizeof m->rest);
        m->is_waiting = 1;
        if (!m->is_running)
            begin_waiting(m, 0.0);
    } else {
        m->v.plan_refused += 1;
    }
    report(m, &verdict, log);
}

/* Go on planning for some units of work. */
static void plan_on(Model *m, int units, const ModelLog *log)
{
    dph_verdict verdict = dph_plan_continue(&m->workspace, &m->waiting, units);
    if (verdict.status != DPH_STATUS_PLANNING)
        conclude(m, verdict, log);
}

/* A new value of task.cancel discards what waits or is being planned; 0 only re-arms. The robot will rest where the running PPO ends: a plan
 * waits for no other. */
static void take_cancel(Model *m, const ModelLog *log)
{
    int32_t cancel = m->v.task_cancel, last = m->last_cancel;
    m->last_cancel = cancel;
    if (cancel == last || cancel == 0 || !(m->is_waiting || m->is_planning))
        return;
    if (m->is_waiting)
        memcpy(m->rest, m->running.task.place, sizeof m->rest);
    m->is_waiting = m->is_planning = 0;
    m->v.plan_status = (int32_t)DPH_STATUS_CANCELLED;
    m->v.plan_required = m->v.plan_available = 0.0;
    m->v.plan_cancelled += 1;
    log->write(log->context, MESSAGE_EVENT, "request cancelled before it began");
}

/* A new value of task.trigger asks for a PPO with the inputs of this moment; 0 only re-arms. */
static void take_request(Model *m, const ModelLog *log)
{
    int32_t trigger = m->v.task_trigger, last = m->last_trigger;
    m->last_trigger = trigger;
    if (trigger == last || trigger == 0)
        return;
    if (m->is_planning || m->is_waiting) {
        refuse_as_busy(m, log);
        return;
    }

    /* Who is at the pick point begins where he rests, to the bit. Who is not is told so only if nothing is wrong with the task itself: the
     * first answer helps more. */
    dph_task task = task_from(&m->v);
    m->away = distance(task.pick, m->rest);
    if (m->away <= at_pick_tolerance)
        start_at_rest(&task, m->rest);
    dph_verdict verdict = dph_plan_begin(&m->robot, &task, &m->workspace, &m->waiting);
    if (verdict.status != DPH_STATUS_PLANNING) {
        conclude(m, verdict, log);
        return;
    }
    m->is_planning = 1;
    m->v.plan_status = (int32_t)verdict.status;
    m->v.plan_required = m->v.plan_available = 0.0;
}

static void write_outputs(Model *m)
{
    Variables *v = &m->v;
    dph_setpoint s = m->standby;
    if (m->has_run)
        dph_plan_sample_at_rate(&m->running, m->elapsed_ms / 1e3, m->feed.rate, &s);
    memcpy(v->joint_position, s.joint_position, sizeof v->joint_position);
    memcpy(v->joint_velocity, s.joint_velocity, sizeof v->joint_velocity);
    memcpy(v->joint_acceleration, s.joint_acceleration, sizeof v->joint_acceleration);
    memcpy(v->joint_torque, s.joint_torque, sizeof v->joint_torque);
    memcpy(v->tcp_position, s.tcp_position, sizeof v->tcp_position);
    memcpy(v->tcp_velocity, s.tcp_velocity, sizeof v->tcp_velocity);
    memcpy(v->tcp_acceleration, s.tcp_acceleration, sizeof v->tcp_acceleration);
    v->path_arc_length = s.arc_length;
    v->path_length = s.length;
    v->path_vertex_distance = s.vertex_distance;
    v->path_phase = (int32_t)s.phase;
    v->plan_busy = m->is_running || m->is_waiting || m->is_planning;
}

/* Rest at the pick point; where that is out of reach the task will be refused, and the arms are level. So will a payload beyond its bounds,
 * which is held as far as they go: torques are those of a mass, and finite. */
static void rest_at_pick(Model *m)
{
    static const double level[3] = {0.0, 0.0, 0.0};
    double payload = fmin(fmax(m->v.payload_mass, 0.0), greatest_payload);
    memcpy(m->rest, m->v.task_pick, sizeof m->rest);
    if (dph_rest(&m->robot, m->rest, payload, &m->standby).status != DPH_STATUS_OK) {
        (void)dph_forward_kinematics(&m->robot, level, m->rest);
        (void)dph_rest(&m->robot, m->rest, payload, &m->standby);
    }
}

int model_initialize(void *model, const ModelLog *log)
{
    Model *m = model;
    m->robot = robot_from(&m->v);
    m->has_run = m->is_running = m->is_waiting = m->is_planning = 0;
    m->away = 0.0;
    m->elapsed_ms = 0.0;
    m->last_trigger = 0;
    m->last_cancel = m->v.task_cancel; /* there is nothing yet to discard */
    feed_start(&m->feed, m->v.feed);
    m->v.plan_status = (int32_t)DPH_STATUS_NONE;
    m->v.plan_count = m->v.plan_refused = m->v.plan_cancelled = 0;
    m->v.plan_required = m->v.plan_available = m->v.plan_duration = 0.0;
    m->v.plan_corner_deviation_pick = m->v.plan_corner_deviation_place = 0.0;

    dph_verdict verdict = dph_robot_check(&m->robot);
    if (verdict.status != DPH_STATUS_OK) {
        char sentence[256];
        dph_verdict_text(&verdict, sentence, (int)sizeof sentence);
        log->write(log->context, MESSAGE_ERROR, sentence);
        return 0;
    }
    rest_at_pick(m);
    take_request(m, log);
    while (m->is_planning)
        plan_on(m, INT_MAX, log);
    write_outputs(m);
    return 1;
}

/* Move the clock of the running plan on. A plan begins and ends at rest, so that what is left of a step goes to the waiting one. */
static void advance_by(Model *m, double ms)
{
    if (!m->is_running)
        return;
    m->elapsed_ms += ms;
    while (m->elapsed_ms >= m->running.duration_ms) {
        if (!m->is_waiting) {
            m->is_running = 0;
            m->elapsed_ms = m->running.duration_ms;
            return;
        }
        begin_waiting(m, m->elapsed_ms - m->running.duration_ms);
    }
}

/* n model steps. */
static void advance(Model *m, uint32_t n)
{
    if (feed_is_settled(&m->feed, m->v.feed)) {
        advance_by(m, n * m->v.feed);
    } else {
        for (uint32_t i = 0; i < n; ++i)
            advance_by(m, 1e3 * feed_step(&m->feed, m->v.feed));
    }
}

void model_step(void *model, uint32_t n, const ModelLog *log)
{
    Model *m = model;
    take_cancel(m, log); /* first, so that one step can exchange what waits for another request */
    take_request(m, log);
    for (; n > 0 && m->is_planning; --n) { /* a slice each millisecond; what is ready then starts then */
        plan_on(m, DPH_SLICE, log);
        advance(m, 1);
    }
    if (n > 0)
        advance(m, n);
    write_outputs(m);
}
