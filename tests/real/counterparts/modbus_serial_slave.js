// The servers of modbus-serial (npm). Usage: node modbus_serial_slave.js serial PORT | tcp NUMBER
const { ServerSerial, ServerTCP } = require("modbus-serial");

const fill = (make) => Array.from({ length: 64 }, (_, at) => make(at));
const coils = fill((at) => at % 3 === 0);
const inputs = fill((at) => at % 2 === 0);
const holding = fill((at) => 500 + at);
const input = fill((at) => 900 + at);

const vector = {
    getCoil: (at) => coils[at],
    getDiscreteInput: (at) => inputs[at],
    getHoldingRegister: (at) => holding[at],
    getInputRegister: (at) => input[at],
    setCoil: (at, value) => { coils[at] = value; },
    setRegister: (at, value) => { holding[at] = value; },
    readDeviceIdentification: () => ({ 0x00: "node", 0x01: "modbus-serial", 0x02: "8" }),
};

const [kind, where] = process.argv.slice(2);
const ready = () => console.log("ready");
if (kind === "serial") {
    new ServerSerial(vector, { path: where, baudRate: 115200, unitID: 5, interval: 1, openCallback: ready });
} else {
    new ServerTCP(vector, { host: "127.0.0.1", port: Number(where), unitID: 5 }).on("initialized", ready);
}
