// Forward declarations of OpenVDB's types: including OpenVDB costs eight seconds per file. Include
// openvdb_grids.h where a grid or a leaf is used. If a file includes both, the compiler
// compares the declarations.
#pragma once

#include <openvdb/version.h>

#include <cstdint>

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {

template <typename Tree>
class Grid;

namespace tree {
template <typename Root>
class Tree;
template <typename Child>
class RootNode;
template <typename Child, std::uint32_t kLog2Dim>
class InternalNode;
template <typename Value, std::uint32_t kLog2Dim>
class LeafNode;
}  // namespace tree

using FloatTree = tree::Tree<
    tree::RootNode<tree::InternalNode<tree::InternalNode<tree::LeafNode<float, 3>, 4>, 5>>>;
using FloatGrid = Grid<FloatTree>;

}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb
