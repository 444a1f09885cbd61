/* What FMI 2.0 and FMI 3.0 share: one instance of the model, its life cycle, its variables, its log and its state.
 *
 * Every function that can fail returns a Status and has then logged a sentence "expected ... but was ...". Nothing is changed by a
 * call that fails, except that STATUS_ERROR, once it reaches instance_end, terminates the instance. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"

/* Numbered as fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status;

/* States of the life cycle, a bit each, so that a set of states is a sum. */
typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, ANY_STATE = 15 } State;

/* Types of variables, a bit each: which of them an API function takes. */
enum {
    TAKES_NONE = 0,
    TAKES_FLOAT64 = 1 << TYPE_FLOAT64,
    TAKES_INT32 = 1 << TYPE_INT32,
    TAKES_BOOLEAN = 1 << TYPE_BOOLEAN,
    TAKES_ENUMERATION = 1 << TYPE_ENUMERATION
};

/* Everything that a simulation changes. It holds no pointers and lies in one piece: an FMU state is a copy of it, and its serialized
 * form is its bytes. The members leave no padding between them; memory comes zeroed, so that equal states have equal bytes. */
typedef struct {
    uint32_t magic;
    uint32_t version;
    uint64_t size;     /* of the whole snapshot [bytes] */
    uint64_t build;    /* hash of the token: states of another build do not fit */
    uint64_t checksum; /* of everything behind it; means something in serialized form only */
    double start_time; /* [s] */
    double stop_time;  /* [s]; INFINITY where the importer gave none */
    uint64_t steps;    /* of MODEL_STEP, done since start_time */
    int32_t state;     /* a State */
    uint8_t prepared;  /* start_time is known */
    uint8_t outdated;  /* something was set since the outputs were computed; initialization only */
    uint8_t unused[2];
    double model[]; /* the model structure */
} Snapshot;

typedef struct Instance Instance;

/* How the FMI version at hand hands a message to the importer. */
typedef void Emit(const Instance *instance, Status status, const char *category, const char *message);

struct Instance {
    const char *name;
    Emit *emit;
    void (*logger)(void); /* the importer's; NULL where it has none */
    void *environment;    /* the importer's, for its logger */
    unsigned logged;      /* categories that are on: a bit per Status */
    const char *function; /* being called, for messages */
    int has_time;         /* `time` is a variable with value reference 0 */
    Snapshot *now;
};

/* Create an instance in state INSTANTIATED with start values. The arguments are those of the FMI functions.
 * Fails: NULL, having logged why: no name, wrong token, no memory.
 * Cost:  two allocations; besides, only FMU states are allocated. */
Instance *instance_create(const char *function, const char *name, const char *token, Emit *emit, void (*logger)(void),
                          void *environment, int logging_on);
void instance_free(Instance *instance);

/* Log why an instance with these properties is refused. Returns NULL. */
Instance *instance_refuse(const char *function, const char *name, Emit *emit, void (*logger)(void), void *environment,
                          const char *reason);

/* Begin an API function: may it be called in the present state? */
Status instance_begin(Instance *instance, const char *function, unsigned states);
/* End it: an error terminates the instance, as the standards have it; it can then be read, restored, reset and freed. */
Status instance_end(Instance *instance, Status status);

/* Log a message in printf form, in the category of its status (OK: events). Errors are always logged, as FMI 3.0.3 recommends and
 * FMI 2.0 expects, other messages where their category is on. Returns status. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
Status instance_log(const Instance *instance, Status status, const char *format, ...);
Status instance_expect_pointer(const Instance *instance, const void *pointer, const char *name);
Status instance_set_logging(Instance *instance, int on, size_t n, const char *const categories[]);

/* Life cycle. */
Status instance_prepare(Instance *instance, double start_time, int stop_time_defined, double stop_time);
Status instance_enter_initialization(Instance *instance);
Status instance_exit_initialization(Instance *instance);
Status instance_terminate(Instance *instance);
Status instance_reset(Instance *instance);

/* Time [s]: start + steps, never a sum. */
double instance_time(const Instance *instance);
/* Advance from `point` by `step` [s]. A step that is no whole number of milliseconds is not done, and is answered with `off_grid`. */
Status instance_do_step(Instance *instance, double point, double step, Status off_grid);

/* Variables. First check, then act: instance_value and instance_assign trust what was checked.
 * Cost: a binary search per value reference. */
Status instance_check_get(Instance *instance, unsigned takes, const uint32_t references[], size_t n, const void *values);
Status instance_check_set(const Instance *instance, unsigned takes, const uint32_t references[], size_t n, const void *values);
Status instance_check_value(const Instance *instance, uint32_t reference, double value);
double instance_value(const Instance *instance, uint32_t reference);
void instance_assign(Instance *instance, uint32_t reference, double value);

/* FMU states: copies of the snapshot. `state` is the importer's void pointer. */
Status instance_get_state(const Instance *instance, void **state);
Status instance_set_state(Instance *instance, const void *state);
Status instance_free_state(const Instance *instance, void **state);
Status instance_state_size(const Instance *instance, const void *state, size_t *size);
Status instance_serialize(const Instance *instance, const void *state, void *bytes, size_t size);
Status instance_deserialize(const Instance *instance, const void *bytes, size_t size, void **state);

#endif
