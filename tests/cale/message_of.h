// The message of the exception that a call throws; empty if it throws none.
#pragma once

#include <exception>
#include <string>

template <class Exception = std::exception, class Call>
std::string message_of(Call&& call) {
    try {
        call();
    } catch (const Exception& error) {
        return error.what();
    }
    return "";
}
