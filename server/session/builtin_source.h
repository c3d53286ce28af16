// Names of builtin volumes, for those who may not know OpenVDB.
#pragma once

#include <string>

namespace palpate {

// Throws Error (kInvalidArgument) where there is no such builtin volume. Any thread.
void CheckBuiltinSource(const std::string& source);

}  // namespace palpate
