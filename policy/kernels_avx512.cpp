// On processors of another family this file is empty.
#if defined(__x86_64__)
#include "policy/kernels_impl.h"

namespace cale::lite {

const Kernels kAvx512Kernels{"avx512", 16, Loops<16, 14>::convolve, Loops<16, 14>::dense};

}  // namespace cale::lite
#endif
