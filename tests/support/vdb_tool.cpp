// vdb_tool: writes .vdb files of many kinds, judges whether two hold the same, and damages them.
// OpenVDB alone reads and writes here.
//
//   make KIND FILE [--edge N] [--seed S]   writes a file
//   compare A B [--grid NAME] [--rounded]  says "equal", or what differs first and exits with 1
//   diff A B [--grid NAME]                 JSON: how many voxels differ, and where
//   usage FILE [--grid NAME]               JSON: memory, bytes; voxels, leaves, box, matrix
//   leaves FILE [--grid NAME]              the origins of all leaves, a line each
//   value FILE I J K [--grid NAME]         value and state of a voxel
//   values FILE [--grid NAME]              the same of many, whose indices stdin holds
//   change WHAT IN OUT                     a copy of one grid of floats, one thing changed
//   fuzz FILE SEED OUT                     a damaged copy
//
// Exit codes: 0; 1 not equal; 2 wrong usage, or a file without what was asked for.
#include "tests/support/vdb_tool.h"

#include <cstdio>
#include <fstream>
#include <functional>
#include <iostream>
#include <iterator>
#include <map>
#include <sstream>

namespace palpate::vdb_tool {
namespace {

using Words = std::vector<std::string>;

struct Arguments {
  Words words;
  std::string grid;  // empty: the only one
  bool rounded = false;
  MakeOptions make;
};

Arguments Parse(int count, char** texts) {
  Arguments arguments;
  for (int n = 1; n < count; ++n) {
    const std::string text = texts[n];
    const auto next = [&]() -> std::string {
      if (n + 1 >= count) throw Failure(text + " lacks its value");
      return texts[++n];
    };
    if (text == "--grid") {
      arguments.grid = next();
    } else if (text == "--edge") {
      arguments.make.edge = std::stoi(next());
    } else if (text == "--seed") {
      arguments.make.seed = static_cast<unsigned>(std::stoul(next()));
    } else if (text == "--rounded") {
      arguments.rounded = true;
    } else {
      arguments.words.push_back(text);
    }
  }
  return arguments;
}

openvdb::GridBase::Ptr Read(const std::string& path, const std::string& name) {
  openvdb::io::File file(path);
  file.open(/*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = file.getGrids();
  if (name.empty()) {
    if (grids->size() == 1) return grids->front();
    throw Failure(path + " holds " + std::to_string(grids->size()) + " grids: name one");
  }
  for (const openvdb::GridBase::Ptr& grid : *grids) {
    if (grid->getName() == name) return grid;
  }
  throw Failure(path + " holds no grid " + name);
}

void Write(const std::string& path, const openvdb::GridPtrVec& grids) {
  openvdb::io::File file(path);
  file.setCompression(openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK);
  file.write(grids);
  file.close();
}

std::string Json(const openvdb::CoordBBox& box) {
  if (box.empty()) return "null";
  std::string text = "[[";
  for (int n = 0; n < 6; ++n) {
    if (n > 0) text += n == 3 ? "], [" : ", ";
    text += std::to_string(n < 3 ? box.min()[n] : box.max()[n - 3]);
  }
  return text + "]]";
}

int Make(const Arguments& arguments) {
  Write(arguments.words[2], MakeGrids(arguments.words[1], arguments.make));
  return 0;
}

int Compare(const Arguments& arguments) {
  const auto a = Read(arguments.words[1], arguments.grid);
  const auto b = Read(arguments.words[2], arguments.grid);
  const std::string first = FirstDifference(*a, *b, arguments.rounded);
  std::printf("%s\n", first.empty() ? "equal" : first.c_str());
  return first.empty() ? 0 : 1;
}

int Diff(const Arguments& arguments) {
  const auto a = Read(arguments.words[1], arguments.grid);
  const auto b = Read(arguments.words[2], arguments.grid);
  const Difference difference = CompareTrees(*a, *b);
  std::printf("{\"voxels\": %lld, \"nodes\": %lld, \"box\": %s}\n",
              static_cast<long long>(difference.voxels), static_cast<long long>(difference.nodes),
              Json(difference.box).c_str());
  return 0;
}

// Of column vectors; null where it is not linear.
std::string Json(const openvdb::math::Transform& transform) {
  if (!transform.isLinear()) return "null";
  const openvdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  std::ostringstream text;
  text.precision(17);
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 4; ++col) {
      text << (col > 0 ? ", " : row > 0 ? "], [" : "[[") << matrix(col, row);
    }
  }
  return text.str() + "]]";
}

int Usage(const Arguments& arguments) {
  const auto grid = Read(arguments.words[1], arguments.grid);
  std::cout << "{\"name\": \"" << grid->getName() << "\", \"type\": \"" << grid->valueType()
            << "\", \"bytes\": " << grid->memUsage()
            << ", \"active_voxels\": " << grid->activeVoxelCount()
            << ", \"leaves\": " << grid->constBaseTree().leafCount()
            << ", \"box\": " << Json(grid->evalActiveVoxelBoundingBox())
            << ", \"world_from_index\": " << Json(grid->transform()) << "}\n";
  return 0;
}

int Leaves(const Arguments& arguments) {
  const auto grid = Read(arguments.words[1], arguments.grid);
  const bool known = VisitGrid(*grid, [](const auto& typed) {
    for (auto leaf = typed.tree().cbeginLeaf(); leaf; ++leaf) {
      const openvdb::Coord origin = leaf->origin();
      std::cout << origin.x() << ' ' << origin.y() << ' ' << origin.z() << '\n';
    }
  });
  if (!known) throw Failure("the leaves of " + grid->type() + " are not listed");
  return 0;
}

void PrintValue(const openvdb::Vec3f& value) {
  std::cout << '[' << value.x() << ", " << value.y() << ", " << value.z() << ']';
}

template <class Value>
void PrintValue(const Value& value) {
  std::cout << value;
}

using Next = std::function<bool(openvdb::Coord&)>;

int PrintValues(const openvdb::GridBase& grid, const Next& next) {
  std::cout.precision(17);
  const bool known = VisitGrid(grid, [&](const auto& typed) {
    const auto accessor = typed.getConstAccessor();
    for (openvdb::Coord at; next(at);) {
      typename std::decay_t<decltype(typed)>::ValueType value;
      const bool active = accessor.probeValue(at, value);
      PrintValue(value);
      std::cout << (active ? " on\n" : " off\n");
    }
  });
  if (!known) throw Failure("grids of " + grid.type() + " have no values");
  return 0;
}

int Value(const Arguments& arguments) {
  const Words& words = arguments.words;
  const openvdb::Coord wanted(std::stoi(words[2]), std::stoi(words[3]), std::stoi(words[4]));
  return PrintValues(*Read(words[1], arguments.grid), [&, left = 1](openvdb::Coord& at) mutable {
    at = wanted;
    return left-- > 0;
  });
}

int Values(const Arguments& arguments) {
  return PrintValues(*Read(arguments.words[1], arguments.grid), [](openvdb::Coord& at) {
    return bool(std::cin >> at.x() >> at.y() >> at.z());
  });
}

int ChangeFile(const Arguments& arguments) {
  const auto grid =
      openvdb::gridPtrCast<openvdb::FloatGrid>(Read(arguments.words[2], arguments.grid));
  if (!grid) throw Failure(arguments.words[2] + " holds no grid of floats");
  Change(arguments.words[1], *grid);
  Write(arguments.words[3], {grid});
  return 0;
}

int Fuzz(const Arguments& arguments) {
  const Words& words = arguments.words;
  std::ifstream in(words[1], std::ios::binary);
  const std::vector<char> bytes = Damaged({std::istreambuf_iterator<char>(in), {}},
                                          static_cast<unsigned>(std::stoul(words[2])));
  std::ofstream out(words[3], std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return in && out ? 0 : throw Failure("a file cannot be read or written");
}

struct Command {
  std::size_t words;
  int (*run)(const Arguments&);
};

int Run(const Arguments& arguments) {
  static const std::map<std::string, Command> commands = {
      {"make", {3, Make}},     {"compare", {3, Compare}},   {"diff", {3, Diff}},
      {"usage", {2, Usage}},   {"leaves", {2, Leaves}},     {"value", {5, Value}},
      {"values", {2, Values}}, {"change", {4, ChangeFile}}, {"fuzz", {4, Fuzz}},
  };
  const auto command = arguments.words.empty() ? commands.end() : commands.find(arguments.words[0]);
  if (command == commands.end() || command->second.words != arguments.words.size()) {
    throw Failure("see the first lines of vdb_tool.cpp for what it takes");
  }
  openvdb::initialize();
  return command->second.run(arguments);
}

}  // namespace
}  // namespace palpate::vdb_tool

int main(int count, char** arguments) {
  try {
    return palpate::vdb_tool::Run(palpate::vdb_tool::Parse(count, arguments));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "vdb_tool: %s\n", error.what());
    return 2;
  }
}
