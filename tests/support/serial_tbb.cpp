// Linked into the tests of the ThreadSanitizer build: TBB's own library is not built
// for it, so that work which its threads share would be reported as races.
#include <tbb/global_control.h>

namespace {

const tbb::global_control serial(tbb::global_control::max_allowed_parallelism, 1);

}  // namespace
