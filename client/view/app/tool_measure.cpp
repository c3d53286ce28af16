#include "client/view/app/tool.h"
#include "client/view/app/viewer.h"

namespace palpate::view {

bool TakeMeasure(Viewer& /*viewer*/, const ViewPointer& /*pointer*/) { return false; }

}  // namespace palpate::view
