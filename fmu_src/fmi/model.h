/* The contract between an FMI adapter and a model: the adapter knows nothing of robots, the model nothing of FMI.
 *
 * A model is one structure without pointers: its generated variables first, its private state behind them. The adapter allocates it
 * zeroed, fills in start values, reads and writes variables through the generated table, copies it as a state, and calls the functions
 * below. Time is counted in whole steps of MODEL_STEP; the model sees no clock. */
#ifndef MODEL_H
#define MODEL_H

#include <stddef.h>
#include <stdint.h>

/* The model's own step [s]; communication steps are whole multiples of it. */
#define MODEL_STEP 1e-3

typedef enum { TYPE_FLOAT64, TYPE_INT32, TYPE_BOOLEAN, TYPE_ENUMERATION } VariableType;
/* `time` alone is independent; the adapter of FMI 3.0 adds it. */
typedef enum { CAUSALITY_PARAMETER, CAUSALITY_INPUT, CAUSALITY_OUTPUT, CAUSALITY_INDEPENDENT } VariableCausality;

/* One scalar variable. Float64 is stored as double, every other type as int32_t. */
typedef struct {
    const char *name;
    uint32_t value_reference;
    VariableType type;
    VariableCausality causality;
    size_t offset;   /* in the model structure */
    double start;    /* 0 for outputs */
    double min, max; /* inclusive; -INFINITY and INFINITY where the table gives none; 0 and the last item for an enumeration */
} Variable;

/* MESSAGE_ERROR: why model_initialize returns 0; nothing else is an error. */
typedef enum { MESSAGE_EVENT, MESSAGE_WARNING, MESSAGE_ERROR } MessageKind;

/* Where a model says what happened; text is a whole sentence without the characters % and #, which mean something to loggers.
 * There always is a log; the adapter decides what comes of a message. */
typedef struct {
    void (*write)(void *context, MessageKind kind, const char *text);
    void *context;
} ModelLog;

/* The model of this library, generated. Variables are sorted by value reference; `time` is not among them. */
typedef struct {
    const char *identifier; /* model identifier */
    const char *token;      /* instantiation token; FMI 2: GUID */
    size_t size;            /* of the model structure [bytes] */
    size_t n_variables;
    const Variable *variables;
} ModelInfo;

extern const ModelInfo model_info;

/* Compute the initial state and the outputs from parameters and inputs. May be called again with other values: forgets everything else.
 * Returns 1, or 0 where no robot can be made of the parameters: the reason is then in the log and the instance is unusable. */
int model_initialize(void *model, const ModelLog *log);

/* Advance by n > 0 steps with the inputs held; outputs are then those at the new time. Never fails: a task that cannot be done is an
 * output, not an error. */
void model_step(void *model, uint32_t n, const ModelLog *log);

#endif
