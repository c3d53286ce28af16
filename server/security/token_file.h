// The file of tokens: TOML, one [[token]] each.
//
// Threads: any; one writer at a time, which the callers see to.
// Errors: Error that names the file.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "server/security/token.h"

namespace palpate {

// Refused where anybody but root or this process's user could have written it: whoever
// writes it makes himself admin.
std::vector<StoredToken> ReadTokenFile(const std::filesystem::path& path);

// Whole or as it was. A new file gets the mode 0640 and its folder's group, so that a
// daemon of that group reads what root writes; one that is there keeps owner and mode.
void WriteTokenFile(const std::filesystem::path& path, const std::vector<StoredToken>& tokens);

// "2027-01-31T12:00:00Z".
std::string ToText(std::chrono::sys_seconds time);

// Throws kPermissionDenied where others than root and this process's user may write the
// file at `path`, kNotFound where there is none.
void CheckOnlyOwnerWrites(const std::filesystem::path& path);

}  // namespace palpate
