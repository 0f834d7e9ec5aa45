#pragma once

#include "mapp/base/rng.h"
#include "mapp/image/image.h"
#include "sim/paint.h"

#include <string>
#include <utility>

namespace mapp::sim {

/// A picture in the making: lengths in metres from the top left, gray levels 0 to 255. Chance comes from `rng`, which
/// must outlive the sheet. Methods throw only what OpenCV throws without memory.
class Sheet {
 public:
  Sheet(const Canvas& canvas, double level, Rng& rng);

  double width_m() const { return canvas_.width_m; }
  double height_m() const { return canvas_.height_m; }

  void Rectangle(double x_m, double y_m, double width_m, double height_m, double level);
  void Disc(double x_m, double y_m, double radius_m, double level);
  void Line(double x0_m, double y0_m, double x1_m, double y1_m, double width_m, double level);
  /// A triangle.
  void Triangle(double x0_m, double y0_m, double x1_m, double y1_m, double x2_m, double y2_m, double level);
  /// An irregular polygon of 3 to 7 corners.
  void Patch(double x_m, double y_m, double radius_m, double level);
  /// A line of print from the top left, capitals `height_m` high.
  void Print(const std::string& text, double x_m, double y_m, double height_m, double level);
  /// One line of chance capitals and digits, `height_m` high, cut at `width_m`.
  void Text(double x_m, double y_m, double width_m, double height_m, double level);
  /// Lines of text that fill a block.
  void Paragraph(double x_m, double y_m, double width_m, double height_m, double glyph_m, double level);
  /// A drawing of discs, patches and lines, as on a poster.
  void Drawing(double x_m, double y_m, double width_m, double height_m);
  /// Stains: patches whose number falls with the cube of their size, so that every scale has its share (the dead
  /// leaves model; Lee, Mumford and Huang, IJCV 2001). `per_m2` counts those above 4 mm.
  void Stains(double per_m2, double contrast);
  /// Adds value noise of all sizes from `coarsest_m` down to single texels, the finer the weaker.
  void Grain(double coarsest_m, double amplitude);
  GrayImage Take() && { return std::move(image_); }

 private:
  int Texels(double length_m) const;

  const Canvas canvas_;
  Rng& rng_;
  GrayImage image_;
};

}  // namespace mapp::sim
