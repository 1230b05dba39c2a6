// Where the wall time of a run goes.
#pragma once

#include <chrono>

namespace cale {

/// Seconds, by what was done in them.
struct TimeSplit {
    double environment = 0;  // emulation and preprocessing
    double replay = 0;       // experiences stored, batches gathered
    double transfer = 0;     // batches on their way to the device
    double act = 0;          // actions chosen
    double update = 0;       // gradient steps
    double log = 0;          // rows, checkpoints
    double evaluation = 0;   // games of evaluations
};

/// Adds the seconds from its birth to its end to `seconds`.
class Timed {
  public:
    explicit Timed(double& seconds) : seconds_(seconds) {}  // must outlive it
    ~Timed() { seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }
    Timed(const Timed&) = delete;
    Timed& operator=(const Timed&) = delete;

  private:
    double& seconds_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cale
