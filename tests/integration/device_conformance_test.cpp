// What every device promises, of those whose emulators have processes or buses of their own.
#include "tests/support/device_conformance.h"
#include "tests/support/falcon_rig.h"
#include "tests/support/forcedimension_rig.h"
#include "tests/support/haply_rig.h"
#include "tests/support/omni_rig.h"

namespace palpate::test {

using Rigs = ::testing::Types<FalconRig, OmegaRig, HaplyRig, OmniRig>;
INSTANTIATE_TYPED_TEST_SUITE_P(Each, DeviceConformance, Rigs, RigNames);

}  // namespace palpate::test
