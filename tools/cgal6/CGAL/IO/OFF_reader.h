// pygalmesh 0.10.7 takes CGAL 6.0 for older than 5.3 and asks for this header, which CGAL 6 no longer has.
#pragma once
#include <CGAL/IO/OFF.h>
namespace CGAL {
using IO::read_OFF;
}
