#pragma once

#include "mapp/base/rng.h"
#include "mapp/image/image.h"

namespace mapp::sim {

/// What a picture is drawn for.
struct Canvas {
  double width_m = 0;
  double height_m = 0;
  double texels_per_m = 0;
};

// Each draws a surface that repeats nowhere and has detail from millimetres to metres, so that corners are found from
// near and far. The same state of `rng` gives the same picture. Throws only what OpenCV throws without memory.

/// Courses of bricks of many lengths and tones, with chips and stains.
GrayImage PaintBricks(const Canvas& canvas, Rng& rng);
/// Cast concrete: formwork panels with seams, tie holes, stencilled numbers and stains.
GrayImage PaintConcrete(const Canvas& canvas, Rng& rng);
/// Plates of metal or gypsum with screws along their edges.
GrayImage PaintPlates(const Canvas& canvas, Rng& rng);
/// Wooden boards with grain and knots, along the width.
GrayImage PaintPlanks(const Canvas& canvas, Rng& rng);
/// A printed sheet: a title, columns of text and a drawing.
GrayImage PaintPoster(const Canvas& canvas, Rng& rng);
/// Shelves full of books, seen from the front.
GrayImage PaintBooks(const Canvas& canvas, Rng& rng);
/// A rug of patches inside a border.
GrayImage PaintRug(const Canvas& canvas, Rng& rng);
/// A carton with tape, labels and print.
GrayImage PaintCarton(const Canvas& canvas, Rng& rng);

}  // namespace mapp::sim
