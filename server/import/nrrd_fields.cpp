#include "server/import/nrrd_fields.h"

#include "server/import/image_header.h"

namespace palpate {
namespace {

std::string FieldName(std::string_view text) {
  std::string name;
  for (const char c : Lower(text)) {
    if (c != ' ') name += c;
  }
  return name;
}

void AddField(std::string_view line, NrrdFields* fields) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) {
    Refuse("the NRRD header has the line " + Quoted(line) + ", which is no field; correct it");
  }
  if (line.substr(colon).starts_with(":=")) return;  // a key with a value, which we ignore
  const std::string name = FieldName(Trim(line.substr(0, colon)));
  if (!fields->emplace(name, Trim(line.substr(colon + 1))).second) {
    Refuse("the NRRD header states " + Quoted(name) + " twice; correct it");
  }
}

}  // namespace

NrrdFields ReadNrrdFields(std::string_view head, bool whole, std::int64_t* end) {
  NrrdFields fields;
  std::size_t at = 0;
  for (bool first = true;; first = false) {
    const std::size_t newline = head.find('\n', at);
    const bool last = newline == std::string_view::npos;
    if (last && !whole) Refuse("the NRRD header is too long; is this an NRRD file?");
    std::string_view line = head.substr(at, last ? std::string_view::npos : newline - at);
    at = last ? head.size() : newline + 1;
    if (line.find('\0') != std::string_view::npos) Refuse("the NRRD header holds binary data");
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() && !first) break;
    if (!first && line[0] != '#') AddField(line, &fields);
    if (last || at >= head.size()) break;
  }
  *end = static_cast<std::int64_t>(at);
  return fields;
}

const std::string& RequiredField(const NrrdFields& fields, std::string_view name) {
  const auto field = fields.find(name);
  if (field == fields.end()) {
    Refuse("the NRRD header has no field '" + std::string(name) +
           "'; the file is damaged or incomplete");
  }
  return field->second;
}

std::optional<std::string> FindField(const NrrdFields& fields, std::string_view name) {
  const auto field = fields.find(name);
  return field == fields.end() ? std::nullopt : std::optional(field->second);
}

}  // namespace palpate
