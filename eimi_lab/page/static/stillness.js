// Decides whether the live picture is still. Earlier edges are drawn only while it is still.
const [WIDE, HIGH] = [160, 128]; // size at which two pictures are compared, px
const LEVELS = 16; // change of a pixel that counts, of 255 grey levels: an edge of good contrast moved by about one thousandth of the picture
const PIXELS = 10; // largest number of changed pixels of a still picture; noise changes fewer

export class Stillness {
  constructor() {
    const small = Object.assign(document.createElement("canvas"), { width: WIDE, height: HIGH });
    this.context = small.getContext("2d", { willReadFrequently: true });
    this.context.imageSmoothingQuality = "medium"; // averages the noise
    this.forget();
  }

  forget() {
    this.before = null;
    this.since = Infinity; // number of the first frame that looks like the frame on the screen
    this.latest = 0; // number of the frame on the screen
  }

  // Compare a frame on its canvas with the first frame that looked like the previous frame.
  see(canvas, number) {
    if (number < this.latest) this.forget(); // a reopened camera counts from 1 again
    this.latest = number;
    this.context.drawImage(canvas, 0, 0, WIDE, HIGH);
    const { data } = this.context.getImageData(0, 0, WIDE, HIGH);
    let changed = this.before === null ? Infinity : 0;
    for (let i = 0; i < data.length && changed <= PIXELS; i += 4)
      if (Math.max(Math.abs(data[i] - this.before[i]), Math.abs(data[i + 1] - this.before[i + 1]), Math.abs(data[i + 2] - this.before[i + 2])) > LEVELS) changed++;
    if (changed > PIXELS) [this.before, this.since] = [data, number];
  }

  // Return whether the edges that were found in frame `number` are valid for the picture on the screen.
  holds(number) { return number >= this.since && number <= this.latest; }
}
