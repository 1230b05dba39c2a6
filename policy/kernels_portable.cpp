#include "policy/kernels_impl.h"

namespace cale::lite {

const Kernels kPortableKernels{"portable", 4, Loops<4, 6>::convolve, Loops<4, 6>::dense};

}  // namespace cale::lite
