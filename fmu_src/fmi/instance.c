/* Creation, log, life cycle and steps of an instance. */
#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "snapshot.h"

/* Longest message [bytes]; what is longer is cut. */
enum { MESSAGE_SIZE = 512 };

/* ---- Log ---------------------------------------------------------------------------------------------------------------------- */

/* Category of a message, by Status. */
static const char *const category_name[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};
enum { CATEGORIES = sizeof category_name / sizeof *category_name, ALL_CATEGORIES = (1 << CATEGORIES) - 1 };

Status instance_log(const Instance *instance, Status status, const char *format, ...)
{
    if (!instance->logger || (status != STATUS_ERROR && !(instance->logged & 1u << status))) {
        return status;
    }
    char message[MESSAGE_SIZE];
    const int prefix = snprintf(message, sizeof message, "%s: ", instance->function);
    if (prefix > 0 && (size_t)prefix < sizeof message) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(message + prefix, sizeof message - (size_t)prefix, format, arguments);
        va_end(arguments);
    }
    /* What an importer wrote may come back in a message: % is a directive to loggers that print, # begins a value reference. */
    for (char *c = message; *c; c++) {
        if (*c == '%' || *c == '#') {
            *c = '_';
        }
    }
    instance->emit(instance, status, category_name[status], message);
    return status;
}

/* What the model says, for the importer's log. */
static void relay(void *context, MessageKind kind, const char *text)
{
    static const Status status[] = {[MESSAGE_EVENT] = STATUS_OK, [MESSAGE_WARNING] = STATUS_WARNING, [MESSAGE_ERROR] = STATUS_ERROR};
    instance_log(context, status[kind], "%s", text);
}

Status instance_set_logging(Instance *instance, int on, size_t n, const char *const categories[])
{
    unsigned chosen = n ? 0 : ALL_CATEGORIES;
    if (n && !categories) {
        return instance_expect_pointer(instance, categories, "categories");
    }
    for (size_t k = 0; k < n; k++) {
        int found = 0;
        for (unsigned category = 0; category < CATEGORIES; category++) {
            if (categories[k] && strcmp(categories[k], category_name[category]) == 0) {
                chosen |= 1u << category;
                found = 1;
            }
        }
        if (!found) {
            return instance_log(instance, STATUS_ERROR, "expected a log category of the model description but was \"%s\"",
                                categories[k] ? categories[k] : "NULL");
        }
    }
    instance->logged = on ? instance->logged | chosen : instance->logged & ~chosen;
    return STATUS_OK;
}

Status instance_expect_pointer(const Instance *instance, const void *pointer, const char *name)
{
    return pointer ? STATUS_OK : instance_log(instance, STATUS_ERROR, "expected a pointer as argument %s but was NULL", name);
}

/* ---- Creation ----------------------------------------------------------------------------------------------------------------- */

Instance *instance_refuse(const char *function, const char *name, Emit *emit, void (*logger)(void), void *environment,
                          const char *reason)
{
    const Instance nobody = {.name = name ? name : "", .emit = emit, .logger = logger, .environment = environment, .function = function};
    instance_log(&nobody, STATUS_ERROR, "%s", reason);
    return NULL;
}

Instance *instance_create(const char *function, const char *name, const char *token, Emit *emit, void (*logger)(void),
                          void *environment, int logging_on)
{
    char reason[MESSAGE_SIZE];
    if (!name || name[strspn(name, " \t\n\r\f\v")] == '\0') {
        return instance_refuse(function, name, emit, logger, environment, "expected an instance name but was empty");
    }
    if (!token || strcmp(token, model_info.token) != 0) {
        snprintf(reason, sizeof reason, "expected the token %s but was %s", model_info.token, token ? token : "NULL");
        return instance_refuse(function, name, emit, logger, environment, reason);
    }
    const size_t name_size = strlen(name) + 1;
    Instance *const self = calloc(1, sizeof(Instance) + name_size); /* the name lies behind the instance */
    Snapshot *const now = calloc(1, snapshot_size());
    if (!self || !now) {
        free(self);
        free(now);
        return instance_refuse(function, name, emit, logger, environment, "expected memory for an instance but was out of it");
    }
    snapshot_start(now);
    self->now = now;
    self->name = memcpy(self + 1, name, name_size);
    self->emit = emit;
    self->logger = logger;
    self->environment = environment;
    self->logged = logging_on ? ALL_CATEGORIES : 0;
    self->function = function;
    return self;
}

void instance_free(Instance *instance)
{
    if (instance) {
        free(instance->now);
        free(instance);
    }
}

/* ---- Calls -------------------------------------------------------------------------------------------------------------------- */

/* Write the names of a set of states: "a or b". */
static void write_states(unsigned states, char *text, size_t size)
{
    static const char *const name[] = {"instantiated", "initialization mode", "step mode", "terminated"};
    size_t used = 0;
    text[0] = '\0';
    for (unsigned k = 0; k < sizeof name / sizeof *name; k++) {
        if (states & 1u << k && used < size) {
            used += (size_t)snprintf(text + used, size - used, "%s%s", used ? " or " : "", name[k]);
        }
    }
}

Status instance_begin(Instance *instance, const char *function, unsigned states)
{
    instance->function = function;
    const unsigned state = (unsigned)instance->now->state;
    if (state & states) {
        return STATUS_OK;
    }
    char expected[64], actual[64];
    write_states(states, expected, sizeof expected);
    write_states(state, actual, sizeof actual);
    return instance_log(instance, STATUS_ERROR, "expected state %s but was %s", expected, actual);
}

Status instance_end(Instance *instance, Status status)
{
    if (status == STATUS_ERROR) {
        instance->now->state = TERMINATED;
    }
    return status;
}

/* ---- Life cycle --------------------------------------------------------------------------------------------------------------- */

Status instance_prepare(Instance *instance, double start_time, int stop_time_defined, double stop_time)
{
    if (!isfinite(start_time)) {
        return instance_log(instance, STATUS_ERROR, "expected a finite start time but was %g", start_time);
    }
    if (stop_time_defined && !(stop_time >= start_time)) {
        return instance_log(instance, STATUS_ERROR, "expected a stop time of at least %.15g s but was %.15g s", start_time, stop_time);
    }
    instance->now->start_time = start_time;
    instance->now->stop_time = stop_time_defined ? stop_time : INFINITY;
    instance->now->prepared = 1;
    return STATUS_OK;
}

Status instance_enter_initialization(Instance *instance)
{
    if (!instance->now->prepared) {
        return instance_log(instance, STATUS_ERROR, "expected a start time before initialization but was none");
    }
    instance->now->state = INITIALIZATION;
    instance->now->outdated = 1;
    return STATUS_OK;
}

Status instance_exit_initialization(Instance *instance)
{
    const ModelLog log = {relay, instance};
    if (!model_initialize(instance->now->model, &log)) {
        return instance_log(instance, STATUS_ERROR, "expected parameters the model can be initialized with but were others");
    }
    instance->now->outdated = 0;
    instance->now->state = STEP;
    return STATUS_OK;
}

Status instance_terminate(Instance *instance)
{
    instance->now->state = TERMINATED;
    return STATUS_OK;
}

Status instance_reset(Instance *instance)
{
    snapshot_start(instance->now);
    return STATUS_OK;
}

/* ---- Steps -------------------------------------------------------------------------------------------------------------------- */

/* The time that many steps after the start [s]. */
static double time_after(const Snapshot *now, uint64_t steps)
{
    return now->start_time + (double)steps * MODEL_STEP;
}

double instance_time(const Instance *instance)
{
    return time_after(instance->now, instance->now->steps);
}

Status instance_do_step(Instance *instance, double point, double step, Status off_grid)
{
    Snapshot *const now = instance->now;
    const double time = instance_time(instance);
    /* Importers that add up their steps drift by 3e-10 of the time in a day of milliseconds (found by adding them up). A quarter of
     * a step at most, so that a wrong step is found however late it is. */
    const double tolerance = fmin(1e-9 * fmax(1.0, fabs(time)), MODEL_STEP / 4);
    if (!(fabs(point - time) <= tolerance)) {
        return instance_log(instance, STATUS_ERROR, "expected the communication point %.15g s but was %.15g s", time, point);
    }
    if (!(step > 0.0)) {
        return instance_log(instance, STATUS_ERROR, "expected a communication step greater than 0 s but was %.15g s", step);
    }
    const double n = floor(step / MODEL_STEP + 0.5);
    /* A step may be the difference of two times, each rounded: late, that is all there is to tolerate. */
    const double rounding = fmin(fmax(1e-9, 4.0 * DBL_EPSILON * fabs(time)), tolerance);
    if (!(n >= 1.0 && n <= (double)UINT32_MAX && fabs(step - n * MODEL_STEP) <= rounding)) {
        return instance_log(instance, off_grid, "expected a communication step that is a multiple of %g s but was %.15g s", MODEL_STEP,
                            step);
    }
    const uint64_t steps = now->steps + (uint64_t)n;
    if (time_after(now, steps) > now->stop_time + tolerance) {
        return instance_log(instance, STATUS_ERROR, "expected a step to the stop time %.15g s at most but was to %.15g s",
                            now->stop_time, time_after(now, steps));
    }
    const ModelLog log = {relay, instance};
    model_step(now->model, (uint32_t)n, &log);
    now->steps = steps;
    return STATUS_OK;
}
