/* Random calls of the C API: legal and illegal sequences, random values, null pointers, wrong counts, broken states.
 *
 *     fuzz CALLS SEED
 *
 * To be compiled with -DVERSION=2 or 3 and -DUNIT='"DeltaPlanner.c"', the FMU's translation unit, under sanitizers: they judge.
 * Prints how many calls were made and how many of them ended with each status. What a caller can do and no callee can survive is
 * left out: dangling pointers, and a count greater than the array it counts. Names bear a prefix: they share the file scope. */
#include UNIT

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if VERSION == 2
#define FMI(name) fmi2##name
#define FMI_STATE(before, after) fmi2##before##FMUstate##after
#define DESERIALIZE fmi2DeSerializeFMUstate
#else
#define FMI(name) fmi3##name
#define FMI_STATE(before, after) fmi3##before##FMUState##after
#define DESERIALIZE fmi3DeserializeFMUState
#endif

enum { INSTANCES = 4, STATES = 6, MOST = 8, STATUSES = 8 };

static Instance *instances[INSTANCES];
static void *states[STATES];
static unsigned char garbage[4096]; /* handed in as a state */
static unsigned char *blob;         /* a serialized state, in memory of its exact size */
static size_t blob_size;
static unsigned long calls, steps, ended[STATUSES], logged;
static int fuzz_calm; /* for a while: few faults, values near the start values, so that instances get old */

/* ---- Randomness: xorshift64* (Vigna) --------------------------------------------------------------------------------------- */

static uint64_t seed;

static uint64_t random_bits(void)
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return seed * 0x2545f4914f6cdd1du;
}

static unsigned fuzz_below(unsigned n)
{
    return (unsigned)((random_bits() >> 32) % n);
}

static int fuzz_rarely(void)
{
    return fuzz_below(fuzz_calm ? 2000 : 40) == 0;
}

static double fuzz_between(double low, double high)
{
    return low + (high - low) * (double)(random_bits() >> 11) / 9007199254740992.0;
}

/* Something that might be a value of a variable. */
static double random_double(const Variable *variable)
{
    static const double odd[] = {0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, 5e-324, INFINITY, -INFINITY, NAN, 1e9, -1e9, 1e-9};
    if (fuzz_calm && variable->causality == CAUSALITY_PARAMETER) {
        return variable->start * fuzz_between(0.99, 1.01);
    }
    if (fuzz_below(fuzz_calm ? 200 : 8) == 0) {
        return odd[fuzz_below(sizeof odd / sizeof *odd)];
    }
    const double start = variable->start;
    switch (fuzz_below(4)) {
    case 0: return start;
    case 1: return start * fuzz_between(0.5, 1.5);
    case 2: return start + fuzz_between(-0.01, 0.01);
    default:
        return fuzz_between(isfinite(variable->min) ? variable->min : -2.0, isfinite(variable->max) ? variable->max : 2.0);
    }
}

static const Variable *random_variable(void)
{
    return &model_info.variables[fuzz_below((unsigned)model_info.n_variables)];
}

/* A pointer, or now and then none. */
static void *or_null(void *pointer)
{
    return fuzz_rarely() ? NULL : pointer;
}

/* ---- Calls ----------------------------------------------------------------------------------------------------------------- */

static void fuzz_count(int status)
{
    calls++;
    ended[status >= 0 && status < STATUSES ? status : STATUSES - 1]++;
}

#if VERSION == 2
static void fuzz_log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment;
    (void)status;
    logged += strlen(name) + strlen(category) + strlen(message);
}
#else
static void fuzz_log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    (void)status;
    logged += strlen(category) + strlen(message);
}
#endif

static void fuzz_make(unsigned which)
{
    static char longest[2000];
    memset(longest, '%', sizeof longest - 1);
    const char *const names[] = {"one", "", NULL, " \t", longest, "name with %s and #5#"};
    const char *const tokens[] = {"{0}", NULL, "", longest};
    const char *const name = fuzz_below(4) ? "one" : names[fuzz_below(6)];
    const char *const token = fuzz_below(8) ? model_info.token : tokens[fuzz_below(4)];
    FMI(FreeInstance)(instances[which]);
#if VERSION == 2
    static const fmi2CallbackFunctions loud = {fuzz_log_message, NULL, NULL, NULL, NULL}, silent = {NULL, NULL, NULL, NULL, NULL};
    const fmi2Type kind = fuzz_rarely() ? fmi2ModelExchange : fmi2CoSimulation;
    const void *const callbacks = fuzz_below(4) ? &loud : &silent;
    instances[which] = fmi2Instantiate(name, kind, token, NULL, or_null((void *)callbacks), 0, fuzz_below(2));
#else
    const fmi3LogMessageCallback logger = fuzz_below(4) ? fuzz_log_message : NULL;
    instances[which] = fmi3InstantiateCoSimulation(name, token, NULL, 0, fuzz_below(2), fuzz_rarely(), fuzz_below(2), NULL,
                                                   fuzz_rarely(), NULL, logger, NULL);
#endif
    fuzz_count(instances[which] ? STATUS_OK : STATUS_ERROR);
}

static int fuzz_enter(Instance *c)
{
    const double start = fuzz_rarely() ? NAN : fuzz_below(2) ? 0.0 : fuzz_between(-10.0, 1e6);
    const double stop = start + fuzz_between(-0.01, 2.0);
#if VERSION == 2
    if (!fuzz_rarely()) {
        fuzz_count(fmi2SetupExperiment(c, 0, 0.0, start, fuzz_below(4) == 0, stop));
    }
    return fmi2EnterInitializationMode(c);
#else
    return fmi3EnterInitializationMode(c, 0, 0.0, start, fuzz_below(4) == 0, stop);
#endif
}

/* Short steps: a long one is legal and takes as long. */
static int fuzz_step(Instance *c)
{
    const double odd_sizes[] = {0.0, -1e-3, 1.5e-3, NAN, INFINITY, -INFINITY, 1e300, 1e-12, 1e-3 + 1e-11};
    const double time = c ? instance_time(c) : 0.0;
    const double point = fuzz_rarely() ? fuzz_between(-1.0, 1.0) : time + (fuzz_rarely() ? 1e-10 : 0.0);
    const double size = fuzz_below(fuzz_calm ? 1000 : 20) ? 1e-3 * (1 + fuzz_below(3)) : odd_sizes[fuzz_below(9)];
#if VERSION == 2
    return fmi2DoStep(c, point, size, 1);
#else
    bool flag[3];
    double last;
    return fmi3DoStep(c, point, size, 1, or_null(&flag[0]), or_null(&flag[1]), or_null(&flag[2]), or_null(&last));
#endif
}

#if VERSION == 2
#define GET(Type, n) fmi2Get##Type(c, or_null(reference), n, or_null(value))
#define SET(Type, n) fmi2Set##Type(c, or_null(reference), n, or_null(value))
#else
#define GET(Type, n) fmi3Get##Type(c, or_null(reference), n, or_null(value), fuzz_rarely() ? n + 1 : n)
#define SET(Type, n) fmi3Set##Type(c, or_null(reference), n, or_null(value), fuzz_rarely() ? n + 1 : n)
#endif

/* Read or write some variables of one type, seldom of others. */
static int fuzz_access(Instance *c, int set)
{
    uint32_t reference[MOST];
    union {
        double reals[MOST];
        int32_t integers[MOST];
        int64_t longs[MOST];
        bool booleans[MOST];
        const char *strings[MOST];
    } buffer;
    void *const value = &buffer;
    const size_t n = fuzz_below(MOST);
    const VariableType type = random_variable()->type;
    memset(&buffer, 0, sizeof buffer);
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = random_variable();
        for (int tries = 0; tries < 200 && (variable->type != type || (set && variable->causality == CAUSALITY_OUTPUT)); tries++) {
            variable = random_variable();
        }
        variable = fuzz_rarely() ? random_variable() : variable;
        reference[k] = fuzz_rarely() ? (uint32_t)random_bits() : variable->value_reference;
        const int number = fuzz_below(8) ? (int)fuzz_below(4) : (int)random_bits();
        switch (type) {
        case TYPE_FLOAT64:
            buffer.reals[k] = random_double(variable);
            break;
#if VERSION == 3
        case TYPE_BOOLEAN:
            buffer.booleans[k] = number & 1;
            break;
        case TYPE_ENUMERATION:
            buffer.longs[k] = fuzz_rarely() ? (int64_t)random_bits() : number;
            break;
#endif
        default:
            buffer.integers[k] = number;
            break;
        }
    }
#if VERSION == 2
    switch (fuzz_rarely() ? (int)fuzz_below(4) : (int)type) {
    case TYPE_FLOAT64: return set ? SET(Real, n) : GET(Real, n);
    case TYPE_INT32:
    case TYPE_ENUMERATION: return set ? SET(Integer, n) : GET(Integer, n);
    default: return fuzz_below(4) ? (set ? SET(Boolean, n) : GET(Boolean, n)) : (set ? SET(String, 0) : GET(String, 0));
    }
#else
    switch (fuzz_rarely() ? (int)fuzz_below(8) : (int)type) {
    case TYPE_FLOAT64: return set ? SET(Float64, n) : GET(Float64, n);
    case TYPE_INT32: return set ? SET(Int32, n) : GET(Int32, n);
    case TYPE_BOOLEAN: return set ? SET(Boolean, n) : GET(Boolean, n);
    case TYPE_ENUMERATION: return set ? SET(Int64, n) : GET(Int64, n);
    case 4: return set ? SET(UInt8, n) : GET(UInt8, n);
    case 5: return set ? SET(Float32, n) : GET(Float32, n);
    case 6: return fmi3GetClock(c, reference, n, value);
    default: return set ? fmi3SetString(c, reference, n, value, n) : fmi3GetString(c, reference, n, value, n);
    }
#endif
}

/* A serialized state: as it was written, cut, longer, or with a bit turned; in memory of exactly its size. */
static int fuzz_deserialize(Instance *c, void **state)
{
    const size_t size = fuzz_rarely() ? fuzz_below(2000) : fuzz_below(4) ? blob_size : (size_t)fuzz_below((unsigned)blob_size + 1);
    unsigned char *const bytes = malloc(size ? size : 1);
    memset(bytes, 0, size);
    memcpy(bytes, blob, size < blob_size ? size : blob_size);
    if (size && fuzz_below(3) == 0) {
        bytes[fuzz_below((unsigned)size)] ^= (unsigned char)(1u << fuzz_below(8));
    }
    if (*state) { /* a deserialized state is a new one */
        fuzz_count(FMI_STATE(Free, )(c, state));
    }
    const int status = *state ? (int)STATUS_DISCARD : (int)DESERIALIZE(c, or_null(bytes), size, or_null(state));
    free(bytes);
    return status;
}

static int fuzz_serialize(Instance *c, void *state)
{
    size_t size = 0;
    fuzz_count(FMI_STATE(Serialized, Size)(c, state, or_null(&size)));
    size = fuzz_rarely() ? fuzz_below(3000) : snapshot_size();
    unsigned char *const bytes = malloc(size ? size : 1);
    const int status = FMI_STATE(Serialize, )(c, state, or_null(bytes), size);
    if (status == STATUS_OK) {
        free(blob);
        blob = bytes;
        blob_size = size;
    } else {
        free(bytes);
    }
    return status;
}

static int fuzz_set_logging(Instance *c)
{
    const char *const categories[] = {"logEvents", "logStatusError", NULL, "no such category %n"};
    const size_t n = fuzz_below(3);
    return FMI(SetDebugLogging)(c, fuzz_below(2), n, or_null((void *)&categories[fuzz_below(16) ? 0 : 2]));
}

/* What these models do not have. */
static int fuzz_refused(Instance *c)
{
    switch (fuzz_below(4)) {
    case 0: return FMI(EnterEventMode)(c);
    case 1: return FMI(SetTime)(c, fuzz_between(-1.0, 1.0));
    case 2: return FMI(EnterContinuousTimeMode)(c);
#if VERSION == 2
    default: return fmi2CancelStep(c);
#else
    default: return fmi3EnterConfigurationMode(c);
#endif
    }
}

#if VERSION == 2
static int fuzz_ask_status(Instance *c)
{
    fmi2Real time;
    fmi2Boolean terminated;
    return fuzz_below(2) ? fmi2GetRealStatus(c, (fmi2StatusKind)fuzz_below(5), or_null(&time))
                    : fmi2GetBooleanStatus(c, (fmi2StatusKind)fuzz_below(5), or_null(&terminated));
}
#endif

/* One call, mostly one that is legal now. */
static void fuzz_call(void)
{
    if (fuzz_below(5000) == 0) {
        fuzz_calm = !fuzz_calm;
    }
    const unsigned which = fuzz_below(INSTANCES);
    Instance *const c = fuzz_rarely() ? NULL : instances[which];
    void **const state = &states[fuzz_below(STATES)];
    void *const handed_in = fuzz_rarely() ? (void *)garbage : *state;
    const int now = c ? c->now->state : 0;
    if (!instances[which] || fuzz_below(2000) == 0 || (now == TERMINATED && fuzz_below(2))) {
        fuzz_make(which);
        return;
    }
    if (fuzz_below(3) && now == INSTANTIATED) {
        fuzz_count(fuzz_below(fuzz_calm ? 8 : 2) == 0 ? fuzz_access(c, 1) : fuzz_enter(c));
        return;
    }
    if (fuzz_below(3) && now == INITIALIZATION) {
        fuzz_count(fuzz_below(2) ? fuzz_access(c, (int)fuzz_below(2)) : (int)FMI(ExitInitializationMode)(c));
        return;
    }
    if (fuzz_below(fuzz_calm ? 100 : 3) && now == STEP) {
        if (fuzz_below(2)) {
            fuzz_count(fuzz_access(c, (int)fuzz_below(2)));
        } else {
            const int status = fuzz_step(c);
            steps += status == STATUS_OK;
            fuzz_count(status);
        }
        return;
    }
    void *no_state = garbage;
    switch (fuzz_below(32)) {
    case 0: fuzz_count(FMI(Terminate)(c)); break;
    case 1: fuzz_count(FMI(Reset)(c)); break;
    case 2: fuzz_count(fuzz_refused(c)); break;
    case 3: fuzz_count(fuzz_enter(c)); break;
    case 4: fuzz_count(FMI(ExitInitializationMode)(c)); break;
    case 5: fuzz_count(fuzz_set_logging(c)); break;
    case 6: fuzz_count(FMI_STATE(Free, )(c, fuzz_rarely() ? &no_state : or_null(state))); break;
    case 7: case 8: case 9: fuzz_count(FMI_STATE(Get, )(c, fuzz_rarely() ? &no_state : or_null(state))); break;
    case 10: case 11: case 12: fuzz_count(FMI_STATE(Set, )(c, handed_in)); break;
    case 13: case 14: fuzz_count(fuzz_serialize(c, handed_in)); break;
    case 15: case 16: fuzz_count(fuzz_deserialize(c, state)); break;
    case 17: case 18: case 19: case 20: fuzz_count(fuzz_step(c)); break;
#if VERSION == 2
    case 21: fuzz_count(fuzz_ask_status(c)); break;
#endif
    default: fuzz_count(fuzz_access(c, (int)fuzz_below(2))); break;
    }
}

int main(int argc, char *argv[])
{
    const unsigned long wanted = argc > 1 ? strtoul(argv[1], NULL, 10) : 1000;
    seed = 0x9e3779b97f4a7c15u ^ (argc > 2 ? strtoul(argv[2], NULL, 10) : 0);
    for (size_t k = 0; k < sizeof garbage; k++) {
        garbage[k] = (unsigned char)random_bits();
    }
    blob_size = snapshot_size();
    blob = calloc(1, blob_size);
    while (calls < wanted) {
        fuzz_call();
    }
    for (int k = 0; k < STATES; k++) {
        fuzz_make(0);
        if (instances[0]) {
            FMI_STATE(Free, )(instances[0], &states[k]);
        } else {
            k--; /* refused: once more */
        }
    }
    for (int k = 0; k < INSTANCES; k++) {
        FMI(FreeInstance)(instances[k]);
    }
    free(blob);
    printf("%lu calls: %lu steps, %lu ok, %lu discarded, %lu errors; %lu characters logged\n", calls, steps, ended[STATUS_OK],
           ended[STATUS_DISCARD], ended[STATUS_ERROR], logged);
    return 0;
}
