// A surface under one light, computed from its normals and its albedo. Angles as in the rest of
// ps4rig: tilt anticlockwise from the right, slant from the direction of the camera.
const LARGEST_SLANT_DEG = 80;
const FLAT = 0.6; // brightness of a flat white surface, whatever the slant
const DIMMEST = Math.cos((LARGEST_SLANT_DEG * Math.PI) / 180);

function pixels(image) {
  const canvas = document.createElement("canvas");
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, canvas.width, canvas.height).data;
}

export class Relit {
  // `slopes` and `albedo` are loaded images of one size, from the pictures of a part.
  constructor(canvas, slopes, albedo) {
    canvas.width = slopes.naturalWidth;
    canvas.height = slopes.naturalHeight;
    this.context = canvas.getContext("2d");
    this.image = this.context.createImageData(canvas.width, canvas.height);
    this.words = new Uint32Array(this.image.data.buffer);
    const coded = pixels(slopes);
    const greys = pixels(albedo);
    const count = this.words.length;
    this.x = new Float32Array(count);
    this.y = new Float32Array(count);
    this.albedo = new Float32Array(count);
    for (let i = 0; i < count; i += 1) {
      const low = coded[4 * i + 2];
      this.x[i] = ((coded[4 * i] << 4) | (low >> 4)) / 2047.5 - 1;
      this.y[i] = ((coded[4 * i + 1] << 4) | (low & 15)) / 2047.5 - 1;
      this.albedo[i] = greys[4 * i];
    }
    this.tiltDeg = 135;
    this.slantDeg = 60;
    this.isGrey = false;
    this.times = 1; // by which slopes are multiplied
  }

  // Aim the light from a point of the picture: -1 to 1 to the right and up, 0 in the middle.
  aim(right, up) {
    if (right !== 0 || up !== 0) this.tiltDeg = (Math.atan2(up, right) * 180) / Math.PI;
    this.slantDeg = LARGEST_SLANT_DEG * Math.min(Math.hypot(right, up), 1);
  }

  turn(tiltDeg, slantDeg) {
    this.tiltDeg += tiltDeg;
    this.slantDeg = Math.min(Math.max(this.slantDeg + slantDeg, 0), LARGEST_SLANT_DEG);
  }

  draw() {
    const tilt = (this.tiltDeg * Math.PI) / 180;
    const slant = (this.slantDeg * Math.PI) / 180;
    const gain = FLAT / Math.max(Math.cos(slant), DIMMEST);
    const lx = gain * Math.cos(tilt) * Math.sin(slant) * this.times;
    const ly = gain * Math.sin(tilt) * Math.sin(slant) * this.times;
    const lz = gain * Math.cos(slant);
    const square = this.times * this.times;
    const { x, y, albedo, words, isGrey } = this;
    for (let i = 0; i < words.length; i += 1) {
      const slope = x[i] * x[i] + y[i] * y[i];
      const z = Math.sqrt(Math.max(1 - slope, 0));
      const lit = (lx * x[i] + ly * y[i] + lz * z) / Math.sqrt(square * slope + z * z);
      const level = Math.min(Math.max(lit, 0) * (isGrey ? 255 : albedo[i]), 255) | 0;
      words[i] = 0xff000000 | (level << 16) | (level << 8) | level;
    }
    this.context.putImageData(this.image, 0, 0);
  }
}
