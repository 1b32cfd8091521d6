// SPDX-License-Identifier: Apache-2.0
// Encoders and valves of four rotors on a serial line, in binary frames: docs/serial.md.

const int ROTORS = 4;
const uint32_t PERIOD = 4000;  // time between frames [us]
const float FULL_TORQUE = 0.1;  // torque of an open valve [N m]

int16_t counts_of(int rotor) { return analogRead(A0 + rotor); }  // return -32768 if there is no encoder
void set_valve(int rotor, float torque) {
  analogWrite(3 + rotor, constrain(255 * torque / FULL_TORQUE, 0, 255));
}

struct __attribute__((packed)) Readings {
  char kind; uint8_t version; uint16_t number; uint32_t time; int16_t counts[ROTORS]; uint32_t crc;
} readings = {'c', 1};
struct __attribute__((packed)) Command {
  char kind; uint8_t version; uint16_t number; uint32_t hold; float torques[ROTORS]; uint32_t crc;
} command;

uint32_t crc32(const uint8_t *bytes, int size) {
  uint32_t crc = 0xFFFFFFFF;
  while (size--) {
    crc ^= *bytes++;
    for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ (crc & 1 ? 0xEDB88320 : 0);
  }
  return ~crc;
}

void send(const uint8_t *bytes, int size) {  // encode as COBS
  for (int at = 0; at <= size;) {
    int run = 0;
    while (at + run < size && bytes[at + run] && run < 254) run++;
    Serial.write((uint8_t)(run + 1));
    Serial.write(bytes + at, run);
    at += run + (run < 254);
  }
  Serial.write((uint8_t)0);
}

bool receive() {  // return whether a complete command has arrived
  static uint8_t frame[sizeof(Command)], code = 255, left = 0;
  static unsigned size = 0;
  while (Serial.available()) {
    uint8_t byte = Serial.read();
    if (byte == 0) {
      bool whole = size == sizeof(Command) && left == 0;
      memcpy(&command, frame, sizeof(Command));
      size = left = 0;
      code = 255;
      if (whole && command.kind == 't' && command.version == 1 &&
          crc32(frame, sizeof(Command) - 4) == command.crc) return true;
      continue;
    }
    bool data = left > 0;
    if (data || code < 255) { if (size < sizeof(Command)) frame[size] = data ? byte : 0; size++; }
    if (data) left--; else { code = byte; left = byte - 1; }
  }
  return false;
}

void setup() { Serial.begin(115200); }

void loop() {
  static uint32_t next = 0, until = 0;
  if (receive()) {
    until = micros() + command.hold;
    for (int rotor = 0; rotor < ROTORS; rotor++) set_valve(rotor, command.torques[rotor]);
  }
  if ((int32_t)(micros() - until) >= 0) {  // command expired: close the valves
    for (int rotor = 0; rotor < ROTORS; rotor++) set_valve(rotor, 0);
    until = micros() + 1000000;
  }
  if ((int32_t)(micros() - next) < 0) return;
  next += PERIOD;
  readings.time = micros();
  for (int rotor = 0; rotor < ROTORS; rotor++) readings.counts[rotor] = counts_of(rotor);
  readings.crc = crc32((uint8_t *)&readings, sizeof(readings) - 4);
  send((uint8_t *)&readings, sizeof(readings));
  readings.number++;
}
