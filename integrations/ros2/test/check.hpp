/* What the tests share. */
#ifndef TROCAR_ROS__TEST__CHECK_HPP_
#define TROCAR_ROS__TEST__CHECK_HPP_

#include <cstdio>

inline int failed = 0;

#define CHECK(condition)                                                                                              \
    do {                                                                                                              \
        if (!(condition)) {                                                                                           \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                      \
            failed = 1;                                                                                               \
        }                                                                                                             \
    } while (0)

#endif // TROCAR_ROS__TEST__CHECK_HPP_
