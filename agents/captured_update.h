// A gradient step launched as one CUDA graph, where there is a CUDA device.
#pragma once

#include <functional>
#include <memory>

#include <ATen/core/Generator.h>
#include <c10/core/Device.h>

namespace cale {

/// Runs the same update repeatedly. On a CUDA device its first runs are launched kernel by kernel, then one
/// is recorded as a CUDA graph, and from then on that graph is replayed: the hundreds of small kernels of an
/// update take longer to launch than to run. Elsewhere every run is a call.
///
/// Requirements on an update: its inputs stay in the same memory from run to run (new values are copied in),
/// its outputs are read after each run or not at all, it never synchronises with the host, and its random
/// numbers come from the given generator. Host scalars are baked into the graph.
class CapturedUpdate {
  public:
    /// `generator`: the device's, from which the update draws; undefined where it draws nothing.
    CapturedUpdate(c10::Device device, at::Generator generator);
    ~CapturedUpdate();

    /// Runs `update` once. It must be the same in every call.
    void operator()(const std::function<void()>& update);
    /// Discards the recording: the next run executes `update` again, with all its assignments, and records
    /// them again.
    void forget();

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
