#pragma once

#include "mapp/base/rng.h"
#include "mapp/image/image.h"
#include "sim/paint.h"

namespace mapp::sim {

// The parts of a car's skin, each on its rectangle; `body` is the gray level of its lacquer. As sim/paint.h.

/// The side from hood to floor, nose to the right: wheels, doors, handles, the shade beneath.
GrayImage PaintCarSide(const Canvas& canvas, double body, Rng& rng);
/// Nose or tail from hood to floor: lamps, grille or bumper, number plate.
GrayImage PaintCarEnd(const Canvas& canvas, double body, bool is_nose, Rng& rng);
/// Hood and trunk lid seen from above, nose to the right.
GrayImage PaintCarTop(const Canvas& canvas, double body, Rng& rng);
/// Roof: ribs, aerial, perhaps a window.
GrayImage PaintCarRoof(const Canvas& canvas, double body, Rng& rng);
/// The row of side windows below the roof.
GrayImage PaintCarWindows(const Canvas& canvas, double body, Rng& rng);
/// Windscreen or rear window, seen from outside.
GrayImage PaintCarScreen(const Canvas& canvas, double body, Rng& rng);

}  // namespace mapp::sim
