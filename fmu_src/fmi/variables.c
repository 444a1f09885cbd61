/* Variables of an instance: looked up by value reference, checked, read and written. Values travel as double, which holds every
 * int32_t exactly. */
#include <math.h>

#include "instance.h"

static const Variable independent = {"time", 0, TYPE_FLOAT64, CAUSALITY_INDEPENDENT, 0, 0.0, -INFINITY, INFINITY};

static const char *const type_name[] = {"Float64", "Int32", "Boolean", "Enumeration"};
static const char *const causality_name[] = {"parameter", "input", "output", "independent variable"};

/* The variable with this value reference, or NULL. */
static const Variable *find(const Instance *instance, uint32_t reference)
{
    if (instance->has_time && reference == independent.value_reference) {
        return &independent;
    }
    size_t low = 0, high = model_info.n_variables; /* among [low, high) */
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const Variable *const variable = &model_info.variables[middle];
        if (variable->value_reference == reference) {
            return variable;
        }
        if (variable->value_reference < reference) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return NULL;
}

static Status check_reference(const Instance *instance, unsigned takes, uint32_t reference)
{
    const Variable *const variable = find(instance, reference);
    if (!variable) {
        return instance_log(instance, STATUS_ERROR, "expected a value reference of the model description but was %lu",
                            (unsigned long)reference);
    }
    if (!(takes & 1u << variable->type)) {
        return instance_log(instance, STATUS_ERROR, "expected a variable of the function's type but was %s, a %s", variable->name,
                            type_name[variable->type]);
    }
    return STATUS_OK;
}

/* To ask for nothing is no error, for whatever type. */
static Status check_references(const Instance *instance, unsigned takes, const uint32_t references[], size_t n, const void *values)
{
    Status status = n ? instance_expect_pointer(instance, references, "valueReferences") : STATUS_OK;
    if (n && status == STATUS_OK) {
        status = instance_expect_pointer(instance, values, "values");
    }
    for (size_t k = 0; k < n && status == STATUS_OK; k++) {
        status = check_reference(instance, takes, references[k]);
    }
    return status;
}

/* Initialization for the sake of the outputs only says why it fails: the last one tells what happens. */
static void errors_only(void *context, MessageKind kind, const char *text)
{
    if (kind == MESSAGE_ERROR) {
        instance_log(context, STATUS_ERROR, "%s", text);
    }
}

Status instance_check_get(Instance *instance, unsigned takes, const uint32_t references[], size_t n, const void *values)
{
    const Status status = check_references(instance, takes, references, n, values);
    Snapshot *const now = instance->now;
    if (status != STATUS_OK || now->state != INITIALIZATION || !now->outdated) {
        return status; /* before initialization an output has no value yet and reads 0 */
    }
    for (size_t k = 0; k < n; k++) {
        if (find(instance, references[k])->causality == CAUSALITY_OUTPUT) {
            const ModelLog log = {errors_only, instance};
            if (!model_initialize(now->model, &log)) {
                return instance_log(instance, STATUS_ERROR,
                                    "expected parameters the model can be initialized with but were others");
            }
            now->outdated = 0;
            break;
        }
    }
    return STATUS_OK;
}

Status instance_check_set(const Instance *instance, unsigned takes, const uint32_t references[], size_t n, const void *values)
{
    const Status status = check_references(instance, takes, references, n, values);
    if (status != STATUS_OK) {
        return status;
    }
    const int parameters_too = instance->now->state != STEP;
    for (size_t k = 0; k < n; k++) {
        const Variable *const variable = find(instance, references[k]);
        if (variable->causality != CAUSALITY_INPUT && !(variable->causality == CAUSALITY_PARAMETER && parameters_too)) {
            return instance_log(instance, STATUS_ERROR, "expected an input%s but was the %s %s",
                                parameters_too ? " or a parameter" : "", causality_name[variable->causality], variable->name);
        }
    }
    return STATUS_OK;
}

/* Discard, not Error: FMI 3.0 (2.2.3) names min/max violations as its example, FMI 2.0 (2.2.7) asks for it on parameters and leaves it
 * to the FMU on inputs. The value is not taken, the instance stays as it was, the importer may offer another. */
Status instance_check_value(const Instance *instance, uint32_t reference, double value)
{
    const Variable *const variable = find(instance, reference);
    if (!isfinite(value)) {
        return instance_log(instance, STATUS_DISCARD, "expected a finite value of %s but was %g", variable->name, value);
    }
    if (value < variable->min || value > variable->max) {
        return instance_log(instance, STATUS_DISCARD, "expected a value of %s from %.15g to %.15g but was %.15g", variable->name,
                            variable->min, variable->max, value);
    }
    return STATUS_OK;
}

double instance_value(const Instance *instance, uint32_t reference)
{
    const Variable *const variable = find(instance, reference);
    if (variable->causality == CAUSALITY_INDEPENDENT) {
        return instance_time(instance);
    }
    const void *const value = (const char *)instance->now->model + variable->offset;
    return variable->type == TYPE_FLOAT64 ? *(const double *)value : (double)*(const int32_t *)value;
}

void instance_assign(Instance *instance, uint32_t reference, double value)
{
    const Variable *const variable = find(instance, reference);
    void *const place = (char *)instance->now->model + variable->offset;
    if (variable->type == TYPE_FLOAT64) {
        *(double *)place = value;
    } else {
        *(int32_t *)place = (int32_t)value;
    }
    instance->now->outdated = 1;
}
