#include "policy/kernels.h"

namespace cale::lite {

const Kernels& kernels() {
#if defined(__x86_64__)
    static const Kernels& best =
        __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") ? kAvx512Kernels
        : __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")       ? kAvx2Kernels
                                                                                : kPortableKernels;
    return best;
#else
    return kPortableKernels;
#endif
}

}  // namespace cale::lite
