// pygalmesh 0.10.7 includes this header, which CGAL 6 no longer has, and uses of it only what it included in turn.
#pragma once
#include <CGAL/Labeled_mesh_domain_3.h>
