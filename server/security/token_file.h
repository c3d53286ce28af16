// Reads and writes the file of tokens: TOML, one [[token]] per token.
//
// Threads: any. The callers make sure that only one writes at a time.
// Errors: Error that names the file.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "server/security/token.h"

namespace palpate {

// Throws if other users than root and this process's user could have written the file: a user who
// writes it could become admin.
std::vector<StoredToken> ReadTokenFile(const std::filesystem::path& path);

// Writes the complete file or leaves it unchanged. A new file gets the mode 0640 and its folder's
// group, so that a daemon of this group can read a file that root writes. An existing file keeps
// its owner and mode.
void WriteTokenFile(const std::filesystem::path& path, const std::vector<StoredToken>& tokens);

// Such as "2027-01-31T12:00:00Z".
std::string ToText(std::chrono::sys_seconds time);

// Throws kPermissionDenied if users other than root and this process's user may write the file at
// `path`, kNotFound if there is no file.
void CheckOnlyOwnerWrites(const std::filesystem::path& path);

}  // namespace palpate
