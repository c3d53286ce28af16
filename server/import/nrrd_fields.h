// Reads the fields of an NRRD header as text.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

// By name, in lower case and without blanks. In some names the blanks are optional.
using NrrdFields = std::map<std::string, std::string, std::less<>>;

// `whole`: `head` is the whole file. Sets `end` to the byte after the header's last line.
NrrdFields ReadNrrdFields(std::string_view head, bool whole, std::int64_t* end);

const std::string& RequiredField(const NrrdFields& fields, std::string_view name);
std::optional<std::string> FindField(const NrrdFields& fields, std::string_view name);

}  // namespace palpate
