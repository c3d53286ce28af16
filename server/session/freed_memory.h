// Gives memory that was freed back to the system.
#pragma once

#include <malloc.h>

namespace palpate {

// After a volume was freed: the heap would keep its bricks, which are small. Takes
// milliseconds, and others who allocate wait meanwhile; the servo does not allocate.
inline void ReturnFreedMemory() { malloc_trim(0); }

}  // namespace palpate
