/* FMI 2.0 Co-Simulation: the API over an instance. Every function reads begin - check - call - end. */
#include "fmi2Functions.h"

#include "instance.h"

/* The standard hands over more than a model of fixed steps has a use for. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* The state machine: which call is legal in which states (FMI 2.0.5, section 4.2.4). The standard's states "terminated" and "error"
 * are one here. A discarded step leaves step mode as it was, so that there is no state "step failed". */
enum {
    MAY_SET_DEBUG_LOGGING    = ANY_STATE,
    MAY_SETUP_EXPERIMENT     = INSTANTIATED,
    MAY_ENTER_INITIALIZATION = INSTANTIATED,
    MAY_EXIT_INITIALIZATION  =                INITIALIZATION,
    MAY_TERMINATE            =                                 STEP,
    MAY_RESET                = ANY_STATE,
    MAY_GET                  =                INITIALIZATION | STEP | TERMINATED,
    MAY_SET                  = INSTANTIATED | INITIALIZATION | STEP,
    MAY_FMU_STATE            = ANY_STATE,
    MAY_DO_STEP              =                                 STEP,
    MAY_GET_STATUS           =                                 STEP | TERMINATED,
};

#define CALL(function)                \
    do {                              \
        status = (function);          \
        if (status > STATUS_WARNING) { \
            goto end;                 \
        }                             \
    } while (0)

#define BEGIN(name, states)            \
    Instance *const self = c;          \
    Status status = STATUS_OK;         \
    if (!self) {                       \
        return fmi2Error;              \
    }                                  \
    CALL(instance_begin(self, name, states));

#define END \
    end:    \
    return (fmi2Status)instance_end(self, status);

/* ---- Creation and log --------------------------------------------------------------------------------------------------------- */

static void emit(const Instance *instance, Status status, const char *category, const char *message)
{
    ((fmi2CallbackLogger)instance->logger)(instance->environment, instance->name, (fmi2Status)status, category, message);
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
    BEGIN("fmi2SetDebugLogging", MAY_SET_DEBUG_LOGGING)
    CALL(instance_set_logging(self, loggingOn, nCategories, categories));
    END
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
    static const char function[] = "fmi2Instantiate";
    if (!functions) {
        return NULL; /* and no logger to say it to */
    }
    void (*const logger)(void) = (void (*)(void))functions->logger;
    if (fmuType != fmi2CoSimulation) {
        return instance_refuse(function, instanceName, emit, logger, functions->componentEnvironment,
                               "expected Co-Simulation but was Model Exchange");
    }
    return instance_create(function, instanceName, fmuGUID, emit, logger, functions->componentEnvironment, loggingOn);
}

void fmi2FreeInstance(fmi2Component c)
{
    instance_free(c);
}

/* ---- Life cycle --------------------------------------------------------------------------------------------------------------- */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    BEGIN("fmi2SetupExperiment", MAY_SETUP_EXPERIMENT)
    CALL(instance_prepare(self, startTime, stopTimeDefined, stopTime));
    END
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    BEGIN("fmi2EnterInitializationMode", MAY_ENTER_INITIALIZATION)
    CALL(instance_enter_initialization(self));
    END
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    BEGIN("fmi2ExitInitializationMode", MAY_EXIT_INITIALIZATION)
    CALL(instance_exit_initialization(self));
    END
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    BEGIN("fmi2Terminate", MAY_TERMINATE)
    CALL(instance_terminate(self));
    END
}

fmi2Status fmi2Reset(fmi2Component c)
{
    BEGIN("fmi2Reset", MAY_RESET)
    CALL(instance_reset(self));
    END
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    BEGIN("fmi2DoStep", MAY_DO_STEP)
    /* A discarded step of FMI 2.0 is one that was done in part (4.2.2), and FMPy asks for the same again, for ever. */
    CALL(instance_do_step(self, currentCommunicationPoint, communicationStepSize, STATUS_ERROR));
    END
}

/* ---- Variables ---------------------------------------------------------------------------------------------------------------- */

#define ACCESS(Type, takes)                                                                                                   \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2##Type value[]) {                \
        BEGIN("fmi2Get" #Type, MAY_GET)                                                                                       \
        CALL(instance_check_get(self, takes, vr, nvr, value));                                                                \
        for (size_t k = 0; k < nvr; k++) {                                                                                    \
            value[k] = (fmi2##Type)instance_value(self, vr[k]);                                                               \
        }                                                                                                                     \
        END                                                                                                                   \
    }                                                                                                                         \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2##Type value[]) {          \
        BEGIN("fmi2Set" #Type, MAY_SET)                                                                                       \
        CALL(instance_check_set(self, takes, vr, nvr, value));                                                                \
        for (size_t k = 0; k < nvr; k++) {                                                                                    \
            CALL(instance_check_value(self, vr[k], (double)value[k]));                                                        \
        }                                                                                                                     \
        for (size_t k = 0; k < nvr; k++) {                                                                                    \
            instance_assign(self, vr[k], (double)value[k]);                                                                   \
        }                                                                                                                     \
        END                                                                                                                   \
    }

ACCESS(Real, TAKES_FLOAT64)
ACCESS(Integer, TAKES_INT32 | TAKES_ENUMERATION)
ACCESS(Boolean, TAKES_BOOLEAN)

/* No variable is a string: legal is only to ask for nothing. */
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    BEGIN("fmi2GetString", MAY_GET)
    CALL(instance_check_get(self, TAKES_NONE, vr, nvr, value));
    END
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    BEGIN("fmi2SetString", MAY_SET)
    CALL(instance_check_set(self, TAKES_NONE, vr, nvr, value));
    END
}

/* ---- FMU state ---------------------------------------------------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    BEGIN("fmi2GetFMUstate", MAY_FMU_STATE)
    CALL(instance_get_state(self, FMUstate));
    END
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    BEGIN("fmi2SetFMUstate", MAY_FMU_STATE)
    CALL(instance_set_state(self, FMUstate));
    END
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    BEGIN("fmi2FreeFMUstate", MAY_FMU_STATE)
    CALL(instance_free_state(self, FMUstate));
    END
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    BEGIN("fmi2SerializedFMUstateSize", MAY_FMU_STATE)
    CALL(instance_state_size(self, FMUstate, size));
    END
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    BEGIN("fmi2SerializeFMUstate", MAY_FMU_STATE)
    CALL(instance_serialize(self, FMUstate, serializedState, size));
    END
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate)
{
    BEGIN("fmi2DeSerializeFMUstate", MAY_FMU_STATE)
    CALL(instance_deserialize(self, serializedState, size, FMUstate));
    END
}

/* ---- Status: steps are done when fmi2DoStep returns --------------------------------------------------------------------------- */

static const char NEVER_PENDING[] = "expected a status that a synchronous model has but was another";

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    BEGIN("fmi2GetStatus", MAY_GET_STATUS)
    CALL(instance_log(self, STATUS_DISCARD, "%s", NEVER_PENDING));
    END
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    BEGIN("fmi2GetRealStatus", MAY_GET_STATUS)
    CALL(instance_expect_pointer(self, value, "value"));
    CALL(s == fmi2LastSuccessfulTime ? STATUS_OK : instance_log(self, STATUS_DISCARD, "%s", NEVER_PENDING));
    *value = instance_time(self);
    END
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    BEGIN("fmi2GetIntegerStatus", MAY_GET_STATUS)
    CALL(instance_log(self, STATUS_DISCARD, "%s", NEVER_PENDING));
    END
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    BEGIN("fmi2GetBooleanStatus", MAY_GET_STATUS)
    CALL(instance_expect_pointer(self, value, "value"));
    CALL(s == fmi2Terminated ? STATUS_OK : instance_log(self, STATUS_DISCARD, "%s", NEVER_PENDING));
    *value = fmi2False; /* these models never ask for the end */
    END
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    BEGIN("fmi2GetStringStatus", MAY_GET_STATUS)
    CALL(instance_log(self, STATUS_DISCARD, "%s", NEVER_PENDING));
    END
}

/* ---- What these models do not have -------------------------------------------------------------------------------------------- */

#define REFUSE(name, reason, parameters)                                                               \
    fmi2Status fmi2##name parameters {                                                                 \
        BEGIN("fmi2" #name, ANY_STATE)                                                                 \
        CALL(instance_log(self, STATUS_ERROR, "expected no such call (" reason ") but was one"));     \
        END                                                                                            \
    }

REFUSE(GetDirectionalDerivative, "providesDirectionalDerivative is false",
       (fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown, const fmi2ValueReference vKnown_ref[],
        size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]))
REFUSE(SetRealInputDerivatives, "canInterpolateInputs is false",
       (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], const fmi2Real value[]))
REFUSE(GetRealOutputDerivatives, "maxOutputDerivativeOrder is 0",
       (fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[]))
REFUSE(CancelStep, "canRunAsynchronuously is false", (fmi2Component c))

#define NO_EXCHANGE "this is no Model Exchange"
REFUSE(EnterEventMode, NO_EXCHANGE, (fmi2Component c))
REFUSE(NewDiscreteStates, NO_EXCHANGE, (fmi2Component c, fmi2EventInfo *eventInfo))
REFUSE(EnterContinuousTimeMode, NO_EXCHANGE, (fmi2Component c))
REFUSE(CompletedIntegratorStep, NO_EXCHANGE,
       (fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint, fmi2Boolean *enterEventMode,
        fmi2Boolean *terminateSimulation))
REFUSE(SetTime, NO_EXCHANGE, (fmi2Component c, fmi2Real time))
REFUSE(SetContinuousStates, NO_EXCHANGE, (fmi2Component c, const fmi2Real x[], size_t nx))
REFUSE(GetDerivatives, NO_EXCHANGE, (fmi2Component c, fmi2Real derivatives[], size_t nx))
REFUSE(GetEventIndicators, NO_EXCHANGE, (fmi2Component c, fmi2Real eventIndicators[], size_t ni))
REFUSE(GetContinuousStates, NO_EXCHANGE, (fmi2Component c, fmi2Real x[], size_t nx))
REFUSE(GetNominalsOfContinuousStates, NO_EXCHANGE, (fmi2Component c, fmi2Real x_nominal[], size_t nx))
