// Gloo is part of libtorch_cpu, but the wheel lacks its headers, which c10d's ProcessGroupGloo.hpp includes.
// It names Gloo's classes and handles pointers to them; these declarations let it be read, and nothing of
// ours calls what they declare. A LibTorch that brings Gloo's own headers is preferred
// (parallel/CMakeLists.txt).
#pragma once

#include <chrono>

namespace gloo {

class Context {
  public:
    void setTimeout(std::chrono::milliseconds timeout);
};

}  // namespace gloo
