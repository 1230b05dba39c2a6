// The settings of a process that make gradient steps on a CPU fast.
#pragma once

namespace cale {

/// Makes this process flush subnormal numbers to zero, keep the pages of freed memory, and ask for huge pages
/// for large tensors. Results are the same but for subnormal numbers. Must be called before LibTorch
/// allocates a tensor or starts a thread.
void prepare_process_for_training();

}  // namespace cale
