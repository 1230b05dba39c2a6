// A build without SDL.
#include <stdexcept>

#include "play/window.h"

namespace cale {

struct Window::Impl {};

Window::Window(int, int, const Dial&) {
    throw std::runtime_error(
        "this build has no windows: install SDL2 (Debian: libsdl2-dev, as scripts/setup does), configure and "
        "build again");
}
Window::~Window() = default;
Window::Window(Window&&) noexcept = default;
Window& Window::operator=(Window&&) noexcept = default;

void Window::show(const Image&, const std::string&) {}
Command Window::poll(Hands&) {
    return Command::quit;
}

}  // namespace cale
