/* Writes jpeg/ycck.jpg, whose inks are those of jpeg/cmyk-adobe.jpg (libjpeg-turbo 2.1.5):
 *   gcc make_ycck.c -ljpeg -o make_ycck && ./make_ycck jpeg/ycck.jpg */
#include <stdio.h>
#include <jpeglib.h>

int main(int argc, char **argv) {
  struct jpeg_compress_struct jpeg;
  struct jpeg_error_mgr errors;
  FILE *out = fopen(argv[argc - 1], "wb");
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  jpeg_stdio_dest(&jpeg, out);
  jpeg.image_width = 16;
  jpeg.image_height = 12;
  jpeg.input_components = 4;
  jpeg.in_color_space = JCS_CMYK;
  jpeg_set_defaults(&jpeg);
  jpeg_set_colorspace(&jpeg, JCS_YCCK);
  jpeg.comp_info[0].h_samp_factor = jpeg.comp_info[0].v_samp_factor = 1;
  jpeg.comp_info[3].h_samp_factor = jpeg.comp_info[3].v_samp_factor = 1;
  jpeg_set_quality(&jpeg, 98, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  for (int y = 0; y < 12; ++y) {
    JSAMPLE line[64], *row = line;
    for (int x = 0; x < 16; ++x) {
      /* Adobe stores one minus the ink. */
      line[4 * x] = 255 - 16 * x;
      line[4 * x + 1] = 255 - 20 * y;
      line[4 * x + 2] = 255 - 9 * (x + y);
      line[4 * x + 3] = 255 - 9 * y;
    }
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  fclose(out);
  return 0;
}
