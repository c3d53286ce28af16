// Names of OpenVDB's types for those who pass them on. Its headers take eight seconds to compile;
// who looks into a grid or a leaf includes <openvdb/openvdb.h>. Where both come together the
// compiler compares them.
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
