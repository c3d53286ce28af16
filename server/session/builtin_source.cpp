#include "server/session/builtin_source.h"

#include "server/volume/builtin.h"

namespace palpate {

void CheckBuiltinSource(const std::string& source) { BuiltinSize(source); }

}  // namespace palpate
