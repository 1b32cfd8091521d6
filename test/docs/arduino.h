// SPDX-License-Identifier: Apache-2.0
// What of Arduino the firmware needs: standard input is what it hears, standard output what it says.
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>

const int A0 = 0, A3 = 3;
static uint32_t clock_now = 0;
static float valves[32];
static std::string heard;

uint32_t micros() { return clock_now; }
int analogRead(int pin) { return 100 * (pin + 1); }
void analogWrite(int pin, float value) { valves[pin] = value; }
float constrain(float value, float low, float high) {
  return value < low ? low : value > high ? high : value;
}

struct String : std::string {
  String(const char *text) : std::string(text) {}
  String(char letter) : std::string(1, letter) {}
  String operator+(long number) const { return *this + String(std::to_string(number).c_str()); }
  String operator+(int number) const { return *this + long(number); }
  String operator+(uint32_t number) const { return *this + long(number); }
  String operator+(const String &other) const { return String((c_str() + std::string(other)).c_str()); }
  String operator+(const char *text) const { return *this + String(text); }
  String operator+(char letter) const { return *this + String(letter); }
};

struct {
  void begin(long) {}
  int available() { return heard.size(); }
  int read() { uint8_t byte = heard[0]; heard.erase(0, 1); return byte; }
  void println(const String &text) { printf("%s\r\n", text.c_str()); }
  void write(uint8_t byte) { fputc(byte, stdout); }
  void write(const uint8_t *bytes, int size) { fwrite(bytes, 1, size, stdout); }
} Serial;

#include FIRMWARE

// Loops for 0.3 s, hears all of standard input at 0.1 s, and tells the valves of each frame.
int main() {
  setup();
  for (clock_now = 0; clock_now < 300000; clock_now += 500) {
    if (clock_now == 100000) for (int byte; (byte = getchar()) != EOF;) heard += char(byte);
    loop();
    if (clock_now % PERIOD == 0) {
      for (int rotor = 0; rotor < ROTORS; rotor++) fprintf(stderr, "%g ", valves[3 + rotor]);
      fputc('\n', stderr);
    }
  }
}
