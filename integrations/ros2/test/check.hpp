/* What the tests share. */
#ifndef TROCAR_ROS__TEST__CHECK_HPP_
#define TROCAR_ROS__TEST__CHECK_HPP_

#include <cstdio>

inline int failed = 0;

#define CHECK(...)                                                                                                    \
    do {                                                                                                              \
        if (!(__VA_ARGS__)) {                                                                                         \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #__VA_ARGS__);                                    \
            failed = 1;                                                                                               \
        }                                                                                                             \
    } while (0)

#endif // TROCAR_ROS__TEST__CHECK_HPP_
