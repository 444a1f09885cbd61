#include "laws.h"

dph_verdict dph_paper_limited_make(dph_plan *plan)
{
    return dph_paper_make(plan);
}
