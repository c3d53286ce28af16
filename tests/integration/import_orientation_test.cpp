// Volumes in all 48 orientations, read by palpate-import, as the viewer's slices show them.
#include <cmath>
#include <sstream>

#include "client/view/drawing/slice_view.h"
#include "tests/integration/image_bytes.h"
#include "tests/integration/import_support.h"
#include "tests/support/orientations.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using view::SliceSide;
using view::SliceView;

// The same in W, whatever the orientation of the file: a grid of these points, x to the left, y to
// posterior, z to superior.
const Vec3i kGrid = {8, 7, 6};
const Vec3 kPitch_mm = {1.0, 1.5, 2.0};
const Vec3 kFirst_W = {-30.0, 20.0, 110.0};
const Vec3i kLump = {6, 3, 2};  // on the left

// A lump on the left, and marks that are anterior and superior of it.
int Content(const Vec3i& p) {
  if (p == kLump) return 100;
  if (p == Vec3i(6, 0, 2) || p == Vec3i(3, 0, 2)) return 60;
  if (p == Vec3i(6, 3, 5) || p == Vec3i(1, 3, 5)) return 30;
  return 0;
}

// The content as the voxels of a file.
struct Oriented {
  Vec3i size;
  AffineMap X_WI;
  std::string voxels;  // int16, x fastest
};

Oriented Orient(const Mat3& orientation) {
  const Mat3 to_index = orientation.transpose();
  Oriented file;
  file.size = (to_index.cwiseAbs() * kGrid.cast<double>()).cast<int>();
  const Vec3 last = file.size.cast<double>() - Vec3::Ones();
  // The grid's point at voxel 0.
  const Vec3 first = 0.5 * (kGrid.cast<double>() - Vec3::Ones() - orientation * last);
  file.X_WI.linear = kPitch_mm.asDiagonal() * orientation;
  file.X_WI.translation = kFirst_W + kPitch_mm.cwiseProduct(first);
  for (int k = 0; k < file.size.z(); ++k) {
    for (int j = 0; j < file.size.y(); ++j) {
      for (int i = 0; i < file.size.x(); ++i) {
        const Vec3 p = first + orientation * Vec3(i, j, k);
        file.voxels += BytesOf(static_cast<std::int16_t>(Content(p.array().round().cast<int>())));
      }
    }
  }
  return file;
}

std::string Join(const Vec3& v, const char* between) {
  std::ostringstream text;
  text << v.x() << between << v.y() << between << v.z();
  return text.str();
}

const Mat3 kRasFromLps = Vec3(-1.0, -1.0, 1.0).asDiagonal();

std::string NrrdOf(const Oriented& file, bool ras) {
  const Mat3 turn = ras ? kRasFromLps : Mat3::Identity();
  std::string text = "NRRD0004\ntype: int16\ndimension: 3\nspace: " +
                     std::string(ras ? "right-anterior-superior" : "left-posterior-superior") +
                     "\nsizes: " + Join(file.size.cast<double>(), " ") + "\nspace directions:";
  for (int axis = 0; axis < 3; ++axis) {
    text += " (" + Join(turn * file.X_WI.linear.col(axis), ",") + ")";
  }
  return text + "\nspace origin: (" + Join(turn * file.X_WI.translation, ",") +
         ")\nendian: little\nencoding: raw\n\n" + file.voxels;
}

class Orientation : public ImportTest {
 protected:
  fs::path WriteDicom(const Oriented& file) const {
    fs::remove_all(Path("series"));
    fs::create_directory(Path("series"));
    const Mat3& axes = file.X_WI.linear;
    const Vec3 pitch_mm = axes.colwise().norm();
    const std::size_t slice_bytes = 2 * static_cast<std::size_t>(file.size.x() * file.size.y());
    for (int k = 0; k < file.size.z(); ++k) {
      SliceFile slice;
      slice.z = k;
      const Vec3 position = file.X_WI.Apply(Vec3(0.0, 0.0, k));
      slice.shift = std::to_string(position.x()) + "\\" + std::to_string(position.y()) + "\\";
      slice.height_mm = position.z();
      slice.orientation =
          Join(axes.col(0).normalized(), "\\") + "\\" + Join(axes.col(1).normalized(), "\\");
      slice.spacing = std::to_string(pitch_mm.y()) + "\\" + std::to_string(pitch_mm.x());
      slice.columns = static_cast<std::uint16_t>(file.size.x());
      slice.rows = static_cast<std::uint16_t>(file.size.y());
      slice.pixels = file.voxels.substr(static_cast<std::size_t>(k) * slice_bytes, slice_bytes);
      Write("series/" + std::to_string(k) + ".dcm", DicomBytes(slice));
    }
    return Path("series");
  }

  // The slice across an axis of W through the lump shows the content as the patient's sides have
  // it. `factor`, `offset`: from content to values.
  static void ExpectSlice(const LoadedVolume& volume, int axis, SliceSide side, int factor,
                          int offset) {
    const AffineMap X_WI = volume.metadata.WorldFromIndex();
    const auto axes = view::SliceInVolume(axis, side, view::NearestAxes(X_WI.linear));
    const SliceView view(axes, volume.metadata.size, volume.metadata.spacing_mm, {400, 300});
    const Vec3 lump_I =
        X_WI.Inverse().Apply(kFirst_W + kPitch_mm.cwiseProduct(kLump.cast<double>()));
    const int right = axis == 0 ? 1 : 0, down = axis == 2 ? 1 : 2;
    const bool mirrored = axis != 0 && side == SliceSide::kNeurological;
    for (int row = 0; row < kGrid[down]; ++row) {
      for (int column = 0; column < kGrid[right]; ++column) {
        Vec3i expected = kLump;
        expected[right] = mirrored ? kGrid[right] - 1 - column : column;
        // Superior is up, posterior is down.
        expected[down] = down == 2 ? kGrid[down] - 1 - row : row;
        const Eigen::Vector2d from_middle = {column - 0.5 * (kGrid[right] - 1),
                                             row - 0.5 * (kGrid[down] - 1)};
        const Eigen::Vector2d at_px = Eigen::Vector2d(200.0, 150.0) +
                                      view.px_per_voxel().cwiseAbs().cwiseProduct(from_middle);
        const Vec3i p_I = view.PointAt(at_px, lump_I[axes.across.axis]).array().round().cast<int>();
        ASSERT_TRUE((p_I.array() >= 0).all() && (p_I.array() < volume.metadata.size.array()).all());
        ASSERT_EQ(At(volume, p_I.x(), p_I.y(), p_I.z()), factor * Content(expected) + offset)
            << axis << ' ' << row << ' ' << column << '\n'
            << X_WI.linear;
      }
    }
  }

  // Also the view: the lump is at its place in W.
  void ExpectSides(const fs::path& path, int factor = 1, int offset = 0) {
    const LoadedVolume volume = Imported(path);
    const AffineMap X_WI = volume.metadata.WorldFromIndex();
    const Vec3 lump_W = kFirst_W + kPitch_mm.cwiseProduct(kLump.cast<double>());
    const Vec3i lump_I = X_WI.Inverse().Apply(lump_W).array().round().cast<int>();
    EXPECT_LT((X_WI.Apply(lump_I.cast<double>()) - lump_W).norm(), 1e-4);
    ASSERT_EQ(At(volume, lump_I.x(), lump_I.y(), lump_I.z()), factor * 100 + offset);
    for (int axis = 0; axis < 3; ++axis) {
      ExpectSlice(volume, axis, SliceSide::kRadiological, factor, offset);
      ExpectSlice(volume, axis, SliceSide::kNeurological, factor, offset);
    }
  }
};

TEST_F(Orientation, OfNrrdInBothSpaces) {
  for (const Mat3& orientation : testing::Orientations()) {
    for (const bool ras : {false, true}) {
      ExpectSides(Write("a.nrrd", NrrdOf(Orient(orientation), ras)));
    }
  }
}

TEST_F(Orientation, OfNifti) {
  for (const Mat3& orientation : testing::Orientations()) {
    const Oriented file = Orient(orientation);
    const AffineMap X_RasI = {kRasFromLps * file.X_WI.linear, kRasFromLps * file.X_WI.translation};
    ExpectSides(Write("a.nii", NiftiBytes(file.size, X_RasI, file.voxels)), 2, -10);
  }
}

// Mirrored ones are those whose slices are numbered against their normal.
TEST_F(Orientation, OfDicom) {
  for (const Mat3& orientation : testing::Orientations()) {
    ExpectSides(WriteDicom(Orient(orientation)), 2, -1024);
  }
}

}  // namespace
}  // namespace palpate
