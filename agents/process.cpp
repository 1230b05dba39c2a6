#include "agents/process.h"

#include <malloc.h>

#include <cstdlib>

#include <ATen/Context.h>

namespace cale {

void prepare_process_for_training() {
    // Adam's averages of weights without gradients decay into subnormal numbers, which cost a CPU a hundred
    // times more: an update would slow down two- to fourfold within an hour. LibTorch's threads inherit the
    // setting. XLA, under the reference, does the same.
    at::globalContext().setFlushDenormal(true);
    // Gradients of tens of megabytes come and go with every update.
    mallopt(M_MMAP_THRESHOLD, 1 << 30);
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
    // LibTorch's own switch, read at its first allocation: dense layers of tens of megabytes are walked many
    // times per update. What the user has set stays.
    ::setenv("THP_MEM_ALLOC_ENABLE", "1", /*overwrite=*/0);
}

}  // namespace cale
