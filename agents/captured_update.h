// A gradient step launched as a whole: a CUDA graph, where there is a CUDA device.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include <ATen/core/Generator.h>
#include <c10/core/Device.h>

namespace cale {

/// Carries out the same update again and again. On a CUDA device its first runs are launched kernel by
/// kernel, then one is recorded as a CUDA graph, and from then on that graph is replayed: the hundreds of
/// small kernels of an update take longer to launch than to run. Elsewhere every run is a call.
///
/// What makes an update fit for it: its inputs stay in the same memory from run to run (new values are
/// copied in), its outputs are read after each run or not at all, it waits for nothing on the host, and
/// what it draws comes from the given generators. Numbers that C++ computes are recorded as they were.
class CapturedUpdate {
  public:
    /// `generators`: those on the device that the update draws from.
    CapturedUpdate(c10::Device device, std::vector<at::Generator> generators);
    ~CapturedUpdate();
    CapturedUpdate(CapturedUpdate&&) noexcept;
    CapturedUpdate& operator=(CapturedUpdate&&) noexcept;

    /// Runs `update` once, which must be the same in every call.
    void operator()(const std::function<void()>& update);
    /// Drops the recording, so that the next run makes a new one and assigns anew what `update` assigns.
    void forget();

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
