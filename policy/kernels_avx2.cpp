// On processors of another family this file is empty.
#if defined(__x86_64__)
#include "policy/kernels_impl.h"

namespace cale::lite {

const Kernels kAvx2Kernels{"avx2", 8, Loops<8, 6>::convolve, Loops<8, 6>::dense};

}  // namespace cale::lite
#endif
