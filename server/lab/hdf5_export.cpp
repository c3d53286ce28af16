#include "server/lab/hdf5_export.h"

#include <hdf5.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "server/recording/recorded_tick.h"

namespace palpate::lab {
namespace {

constexpr hsize_t kRowsPerChunk = 4096;
constexpr unsigned kDeflateLevel = 4;

// Closes what it holds; every call of HDF5 gives an id, or a negative number for an error.
class Id {
 public:
  Id(hid_t id, herr_t (*close)(hid_t)) : id_(Checked(id)), close_(close) {}
  ~Id() { close_(id_); }
  Id(const Id&) = delete;
  Id& operator=(const Id&) = delete;
  operator hid_t() const { return id_; }

  template <class Result>
  static Result Checked(Result result) {
    if (result < 0)
      throw Error(ErrorKind::kUnavailable, "cannot write the HDF5 file; is there space?");
    return result;
  }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

template <class Number>
hid_t TypeOf() {
  if constexpr (std::is_same_v<Number, double>) return H5T_NATIVE_DOUBLE;
  if constexpr (std::is_same_v<Number, std::int64_t>) return H5T_NATIVE_INT64;
  if constexpr (std::is_same_v<Number, std::uint64_t>) return H5T_NATIVE_UINT64;
  if constexpr (std::is_same_v<Number, std::uint32_t>) return H5T_NATIVE_UINT32;
  return H5T_NATIVE_UINT8;
}

std::string UnitOf(std::string_view name) {
  if (name.ends_with("_n_mm")) return "N mm";
  const std::string_view end = name.substr(name.rfind('_') + 1);
  if (end == "n") return "N";
  return end == "mm" || end == "ns" ? std::string(end) : "";
}

void PutText(hid_t of, const char* name, const std::string& text) {
  if (text.empty()) return;
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose), space(H5Screate(H5S_SCALAR), H5Sclose);
  Id::Checked(H5Tset_size(type, text.size()));
  const Id attribute(H5Acreate2(of, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  Id::Checked(H5Awrite(attribute, type, text.data()));
}

// An array that grows by rows.
class Column {
 public:
  Column(hid_t file, const std::string& path, hid_t type, std::size_t number_bytes,
         hsize_t numbers_per_row, const std::string& words = "")
      : type_(type), row_bytes_(number_bytes * numbers_per_row), width_(numbers_per_row) {
    const int axes = width_ > 1 ? 2 : 1;
    const hsize_t none[] = {0, width_}, most[] = {H5S_UNLIMITED, width_};
    const hsize_t chunk[] = {kRowsPerChunk, width_};
    const Id space(H5Screate_simple(axes, none, most), H5Sclose);
    const Id layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    const Id links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
    Id::Checked(H5Pset_chunk(layout, axes, chunk));
    Id::Checked(H5Pset_deflate(layout, kDeflateLevel));
    Id::Checked(H5Pset_create_intermediate_group(links, 1));
    set_ = Id::Checked(H5Dcreate2(file, path.c_str(), type, space, links, layout, H5P_DEFAULT));
    PutText(set_, "unit", UnitOf(path));
    PutText(set_, "words", words);
  }
  ~Column() { H5Dclose(set_); }
  Column(const Column&) = delete;

  void Add(const void* numbers) {
    rows_.append(static_cast<const char*>(numbers), row_bytes_);
    if (rows_.size() == kRowsPerChunk * row_bytes_) Flush();
  }
  void Flush() {
    const hsize_t rows = rows_.size() / row_bytes_;
    if (rows == 0) return;
    const int axes = width_ > 1 ? 2 : 1;
    const hsize_t first[] = {written_, 0}, count[] = {rows, width_};
    const hsize_t size[] = {written_ + rows, width_};
    Id::Checked(H5Dset_extent(set_, size));
    const Id place(H5Dget_space(set_), H5Sclose);
    const Id memory(H5Screate_simple(axes, count, nullptr), H5Sclose);
    Id::Checked(H5Sselect_hyperslab(place, H5S_SELECT_SET, first, nullptr, count, nullptr));
    Id::Checked(H5Dwrite(set_, type_, memory, place, H5P_DEFAULT, rows_.data()));
    written_ += rows;
    rows_.clear();
  }

 private:
  hid_t type_;
  std::size_t row_bytes_;
  hsize_t width_;
  hid_t set_ = -1;
  hsize_t written_ = 0;
  std::string rows_;
};

class Tables {
 public:
  explicit Tables(hid_t file) : file_(file) {}

  void Add(const TickSample& sample) {
    path_ = "/ticks/";
    Add(RecordedTickOf(sample));
  }

  template <class Number>
  requires std::is_arithmetic_v<Number>
  void Add(const std::string& path, Number number) { Row<Number>(path, &number); }

  void Flush() {
    for (auto& [path, column] : columns_) column.Flush();
  }

 private:
  // The fields of a value of the contract; those of one within have its name before theirs.
  template <class Value>
  void Add(const Value& value) {
    VisitFields(value, [this](std::string_view name, const auto& field) {
      this->AddField(std::string(name), field);
    });
  }

  template <class Field>
  void AddField(const std::string& name, const Field& field) {
    if constexpr (std::is_enum_v<Field>) {
      std::string words;
      for (std::size_t n = 0; n < kWords<Field>.size() && !columns_.contains(path_ + name); ++n) {
        words += (n > 0 ? ", " : "") + std::to_string(n + 1) + ": " + std::string(kWords<Field>[n]);
      }
      const auto number = static_cast<std::uint8_t>(field);
      Row<std::uint8_t>(path_ + name, &number, 1, words);
    } else if constexpr (std::is_same_v<Field, bool>) {
      Add(path_ + name, static_cast<std::uint8_t>(field));
    } else if constexpr (std::is_arithmetic_v<Field>) {
      Add(path_ + name, field);
    } else if constexpr (std::is_same_v<Field, Vec3>) {
      Row<double>(path_ + name, field.data(), 3);
    } else if constexpr (std::is_same_v<Field, UnalignedQuaternion>) {
      const double numbers[] = {field.w(), field.x(), field.y(), field.z()};
      Row<double>(path_ + name, numbers, 4);
    } else if constexpr (std::is_same_v<Field, std::optional<Vec3>>) {
      AddField(name, field.value_or(Vec3::Constant(TickSample::kNone)));
    } else if constexpr (std::is_same_v<Field, std::optional<UnalignedQuaternion>>) {
      constexpr double kNone = TickSample::kNone;
      AddField(name, field.value_or(UnalignedQuaternion(kNone, kNone, kNone, kNone)));
    } else if constexpr (std::is_same_v<Field, std::optional<double>>) {
      AddField(name, field.value_or(TickSample::kNone));
    } else if constexpr (std::is_same_v<Field, PoseSample>) {
      Add(field);
    } else {
      const std::string outer = path_;
      path_ += name.substr(0, name.size() - name.ends_with('s')) + "_";  // force_state
      Add(field);
      path_ = outer;
    }
  }

  template <class Number>
  void Row(const std::string& path, const Number* numbers, hsize_t count = 1,
           const std::string& words = "") {
    auto column = columns_.find(path);
    if (column == columns_.end()) {
      column =
          columns_.try_emplace(path, file_, path, TypeOf<Number>(), sizeof(Number), count, words)
              .first;
    }
    column->second.Add(numbers);
  }

  hid_t file_;
  std::string path_;
  std::map<std::string, Column> columns_;
};

void WriteTexts(hid_t file, const std::string& path, const std::vector<std::string>& texts) {
  std::size_t longest = 1;
  for (const std::string& text : texts) longest = std::max(longest, text.size());
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  Id::Checked(H5Tset_size(type, longest));
  Id::Checked(H5Tset_cset(type, H5T_CSET_UTF8));
  Id::Checked(H5Tset_strpad(type, H5T_STR_NULLPAD));
  Column column(file, path, type, longest, 1);
  for (std::string text : texts) {
    text.resize(longest);
    column.Add(text.data());
  }
  column.Flush();
}

}  // namespace

void ExportHdf5(RecordingReader& reader, const std::filesystem::path& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // our errors say it
  const Id file(H5Fcreate(path.c_str(), H5F_ACC_EXCL, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
  PutText(file, "program", reader.header().program);
  Tables tables(file);
  std::vector<std::string> markers;
  while (const std::optional<RecordedItem> item = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
      for (const TickSample& sample : *samples) {
        tables.Add(sample);
        if (!reader.header().created_monotonic_ns) continue;
        // Of a damaged time: the least number.
        tables.Add("/ticks/unix_ns", reader.header()
                                         .UnixOf(sample.time_ns)
                                         .value_or(std::numeric_limits<std::int64_t>::min()));
      }
    } else if (const auto* event = std::get_if<RecordedEvent>(&*item)) {
      tables.Add("/markers/tick", event->tick);
      tables.Add("/markers/time_ns", event->time_ns);
      markers.push_back(event->marker);
    }
  }
  tables.Flush();
  if (!markers.empty()) WriteTexts(file, "/markers/text", markers);
  // Much is written only now; closing the file would tell nobody that it failed.
  Id::Checked(H5Fflush(file, H5F_SCOPE_GLOBAL));
}

}  // namespace palpate::lab
