#include "server/recording/csv_export.h"

#include <array>
#include <charconv>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "server/recording/sample_fields.h"

namespace palpate {
namespace {

template <class Field>
void AppendField(const Field& field, std::string& row) {
  if constexpr (std::is_enum_v<Field>) {
    row += NameOf(field);
  } else if constexpr (std::is_same_v<Field, bool>) {
    row += field ? '1' : '0';
  } else {
    std::array<char, 32> digits;
    row.append(digits.data(),
               std::to_chars(digits.data(), digits.data() + digits.size(), field).ptr);
  }
  row += ',';
}

std::string Header() {
  std::string row;
  const TickSample sample;
  VisitFields(sample, [&](std::string_view name, const auto&) { row.append(name).append(","); });
  return row + "unix_ns,markers";
}

// Adds quotes if commas, quotes or line ends would break the table.
std::string Quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return quoted + '"';
}

// Holds back the last row: only the time of the next tick tells which markers belong to it.
class Table {
 public:
  // `unix_from_time_ns`: from a tick's time to its UTC.
  Table(std::ostream& stream, std::optional<std::int64_t> unix_from_time_ns)
      : stream_(stream), unix_from_time_ns_(unix_from_time_ns) {
    stream_ << Header() << '\n';
  }

  void Add(const TickSample& sample) {
    if (!row_.empty()) WriteRow(sample.time_ns);
    row_.clear();
    VisitFields(sample, [&](std::string_view name, const auto& field) {
      // What the tick does not have is empty, which other programs read as missing.
      const bool is_absent = (!sample.contact && name.starts_with("scp_h_normal")) ||
                             (!sample.has_scp_v && name.starts_with("scp_v"));
      if (is_absent) {
        row_ += ',';
      } else {
        AppendField(field, row_);
      }
    });
    // Of a damaged time, the sum may be too large.
    std::int64_t unix_ns = 0;
    if (unix_from_time_ns_ &&
        !__builtin_add_overflow(sample.time_ns, *unix_from_time_ns_, &unix_ns)) {
      row_ += std::to_string(unix_ns);
    }
    row_ += ',';
  }

  void Add(TimedMarker marker) { markers_.push_back(std::move(marker)); }

  void End() {
    if (!row_.empty()) WriteRow({});
    stream_.flush();
    CheckStream();
  }

 private:
  void WriteRow(std::optional<std::int64_t> next_ns) {
    std::string texts;
    while (!markers_.empty() && (!next_ns || markers_.front().time_ns < *next_ns)) {
      texts += (texts.empty() ? "" : "; ") + markers_.front().text;
      markers_.pop_front();
    }
    stream_ << row_ << Quoted(texts) << '\n';
    CheckStream();
  }

  void CheckStream() const {
    if (!stream_) {
      throw Error(ErrorKind::kUnavailable, "cannot write the table; is there space?");
    }
  }

  std::ostream& stream_;
  const std::optional<std::int64_t> unix_from_time_ns_;
  std::string row_;
  std::deque<TimedMarker> markers_;  // that have no row yet
};

std::optional<std::int64_t> UnixFromTimeNs(const RecordingHeader& header) {
  std::int64_t difference = 0;
  if (!header.created_monotonic_ns ||
      __builtin_sub_overflow(header.created_unix_ns, *header.created_monotonic_ns, &difference)) {
    return std::nullopt;
  }
  return difference;
}

}  // namespace

void ExportCsv(RecordingReader& reader, std::ostream& stream) {
  Table table(stream, UnixFromTimeNs(reader.header()));
  while (std::optional<RecordedChunk> chunk = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*chunk)) {
      for (const TickSample& sample : *samples) table.Add(sample);
    } else if (auto* marker = std::get_if<TimedMarker>(&*chunk)) {
      table.Add(std::move(*marker));
    }
  }
  table.End();
}

void ExportCsv(std::span<const TickSample> ticks, std::ostream& stream) {
  Table table(stream, {});
  for (const TickSample& sample : ticks) table.Add(sample);
  table.End();
}

}  // namespace palpate
